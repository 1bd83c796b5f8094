"""Every decoder and every file reader on hostile bytes, each fuzzed for the same time."""

import argparse
import re
import shutil
import tempfile
from pathlib import Path

from benchmarks.lib.table import markdown, write
from tests.fuzz import harness
from tests.fuzz.target import Target

STATISTICS = (r"stat::number_of_executed_units:\s+(\d+)", r"stat::peak_rss_mb:\s+(\d+)")
PROGRESS = re.compile(r"cov: (\d+) ft: \d+ corp: (\d+)/(\w+)")
BESIDE = (".txt", ".dict")  # what lies beside findings

INTRODUCTION = (
    "Each target begins with sound inputs of its own making, and is fuzzed by "
    "[Atheris](https://github.com/google/atheris) (libFuzzer), which sees the coverage of our code "
    "and of the Python libraries behind it. An input may be refused with an error that tells a "
    "user what is wrong. Anything else is a finding: another exception, more than 1 GiB of "
    "memory, more than 2 s of the processor, a crash. `coverage` counts edges of the control flow."
)


def row(target: Target, seconds: float, corpus: Path, found: Path) -> list[str]:
    """Fuzz one target and return its row of the table."""
    shutil.rmtree(found, ignore_errors=True)
    took_s = harness.fuzz(target, corpus, found, seconds)
    told = (found / harness.LOG).read_text(errors="replace")
    executions, peak_mb = ((re.findall(form, told) or ["?"])[-1] for form in STATISTICS)
    coverage, count, size = (PROGRESS.findall(told) or [("?", "?", "?")])[-1]
    kept = [file for file in found.iterdir() if file.suffix not in BESIDE]
    findings = f"{len(kept)}" if kept or executions != "?" else "did not run"
    return [
        target.name,
        executions,
        f"{took_s:.0f}",
        coverage,
        f"{count} ({size})",
        peak_mb,
        findings,
    ]


def main() -> None:
    """Fuzz and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="*", help="names, or parts of them; all if none")
    parser.add_argument(
        "--minutes", type=float, default=30.0, help="of one processor, for all targets together"
    )
    parser.add_argument("--corpus", type=Path, help="folder to begin with and to keep inputs in")
    parser.add_argument("--found", type=Path, default=Path("out/fuzz"), help="folder of findings")
    flags = parser.parse_args()
    known = harness.load().items()
    from tests.fuzz.regressions import REGRESSIONS  # noqa: PLC0415  # imports what is instrumented

    chosen = [t for name, t in known if not flags.targets or any(f in name for f in flags.targets)]
    seconds = flags.minutes * 60 / max(1, len(chosen))
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for target in chosen:
            place = re.sub(r"\W+", "_", target.name)
            corpus = (flags.corpus or Path(folder)) / place
            rows.append(row(target, seconds, corpus, (flags.found / place).absolute()))
            print(*rows[-1], sep=" | ", flush=True)
    total = sum(int(cells[1]) for cells in rows if cells[1].isdigit())
    header = ["target", "executions", "seconds", "coverage", "corpus", "peak MB", "findings"]
    past = [f"- {regression.name}: {regression.story}" for regression in REGRESSIONS]
    write(
        __file__,
        "Hostile bytes: fuzzing of decoders and file readers",
        INTRODUCTION,
        f"{total:,} executions in {flags.minutes:g} minutes of one processor.",
        markdown(header, rows),
        "Found so far, fixed, and kept as a test each (`tests/fuzz/regressions.py`):",
        "\n".join(past) or "- nothing",
    )


if __name__ == "__main__":
    main()
