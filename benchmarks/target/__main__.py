"""Run the benchmark of the chosen person; worker processes import its functions by name."""

from benchmarks.target.table import main

if __name__ == "__main__":
    main()
