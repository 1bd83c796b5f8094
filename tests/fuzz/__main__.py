"""Fuzz every decoder and file reader for the same time, and write benchmarks/fuzz.md."""

import argparse
import re
import shutil
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests import ROOT
from tests.fuzz import harness
from tests.fuzz.target import Target

STARTS = (
    "tests.fuzz.messages",
    "tests.fuzz.files",
    "tests.fuzz.state",
    "tests.fuzz.clients",
    "tests.fuzz.sequences",
)
EXECUTIONS = re.compile(r"stat::number_of_executed_units:\s+(\d+)")
OTHER_FILES = (".txt", ".dict")  # suffixes of files other than findings

TABLE = ROOT / "benchmarks" / "fuzz.md"
HEADER = ["target", "executions", "findings"]
PAGE = """\
# Hostile bytes: fuzzing of decoders and file readers

Made by `python -m tests.fuzz` on {machine}.

Each target begins with valid inputs, and is fuzzed by \
[Atheris](https://github.com/google/atheris) (libFuzzer), guided by the coverage of our code \
and of the Python libraries below it. An input may be rejected with an error that names the fault. \
A finding is another exception, a crash, or more than 1 GiB of memory or 2 s of the processor.

{total:,} executions in {minutes:g} minutes of one processor.

Every fault found is fixed and has a test in `tests/fuzz/regressions.py`.

{table}
"""


def row(target: Target, seconds: float, corpus: Path, found: Path) -> list[str]:
    """Fuzz one target and return its row of the table."""
    shutil.rmtree(found, ignore_errors=True)
    harness.fuzz(target, corpus, found, seconds)
    log = (found / harness.LOG).read_text(errors="replace")
    executions = (EXECUTIONS.findall(log) or ["?"])[-1]
    inputs = [file for file in found.iterdir() if file.suffix not in OTHER_FILES]
    count_text = f"{len(inputs)}" if inputs or executions != "?" else "did not run"
    return [target.name, executions, count_text]


def main() -> None:
    """Fuzz and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="*", help="names, or parts of them; all if none")
    parser.add_argument(
        "--minutes", type=float, default=30.0, help="of one processor, for all targets together"
    )
    parser.add_argument("--jobs", type=int, default=1, help="targets at once")
    parser.add_argument("--corpus", type=Path, help="folder of inputs, read and added to")
    parser.add_argument("--found", type=Path, default=Path("out/fuzz"), help="folder of findings")
    flags = parser.parse_args()
    targets = harness.load().items()
    chosen = [
        t for name, t in targets if not flags.targets or any(f in name for f in flags.targets)
    ]
    seconds = flags.minutes * 60 / max(1, len(chosen))

    def work(target: Target) -> list[str]:
        name = re.sub(r"\W+", "_", target.name)
        corpus = (flags.corpus or Path(folder)) / name
        cells = row(target, seconds, corpus, (flags.found / name).absolute())
        print(*cells, sep=" | ", flush=True)
        return cells

    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(flags.jobs) as pool:
        rows = list(pool.map(work, chosen))
    from benchmarks.lib.table import machine  # noqa: PLC0415 (no part of the fuzzed processes)

    lines = [HEADER, ["---"] * len(HEADER), *rows]
    page = PAGE.format(
        machine=machine(),
        total=sum(int(cells[1]) for cells in rows if cells[1].isdigit()),
        minutes=flags.minutes,
        table="\n".join(f"| {' | '.join(line)} |" for line in lines),
    )
    TABLE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
