"""Run the command line as python -m deploy.cli."""

from people4d_command import main

if __name__ == "__main__":
    main()
