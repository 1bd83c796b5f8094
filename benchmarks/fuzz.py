"""Every decoder and every file reader on hostile bytes, each fuzzed for the same time."""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.table import markdown, write
from tests.fuzz.regressions import REGRESSIONS

ROOT = Path(__file__).resolve().parents[1]
RSS_MB = 2048
TIMEOUT_S = 30  # of one input
STATISTICS = {
    "executions": r"stat::number_of_executed_units:\s+(\d+)",
    "peak MB": r"stat::peak_rss_mb:\s+(\d+)",
}
PROGRESS = re.compile(r"cov: (\d+) ft: \d+ corp: (\d+)/(\w+)")

INTRODUCTION = (
    "Each target begins with sound inputs of its own making, and is fuzzed by "
    "[Atheris](https://github.com/google/atheris) (libFuzzer), which sees the coverage of our code "
    "and of the Python libraries behind it. An input may be refused with an error that tells a "
    "user what is wrong. Anything else is a finding: another exception, more than 1 GiB of "
    "memory, more than 2 s of the processor, a crash. `coverage` counts edges of the control flow."
)


def names() -> list[str]:
    """Return the targets; they are listed by a process of its own, which imports them."""
    code = "from tests.fuzz.targets import TARGETS; print(*TARGETS, sep='\\n')"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, check=True)
    return done.stdout.decode().splitlines()


def fuzz(name: str, seconds: float, corpus: Path, found: Path) -> list[str]:
    """Fuzz one target and return its row of the table."""
    corpus.mkdir(parents=True, exist_ok=True)
    found.mkdir(parents=True, exist_ok=True)
    limits = [f"-max_total_time={seconds:.0f}", f"-rss_limit_mb={RSS_MB}", f"-timeout={TIMEOUT_S}"]
    command = [sys.executable, "-m", "tests.fuzz.harness", name, str(corpus), str(found)]
    begin_s = time.monotonic()
    done = subprocess.run(
        ["nice", *command, *limits, "-print_final_stats=1", "-close_fd_mask=3"],
        cwd=ROOT,
        check=False,  # a finding that ends it is told in the table
        stderr=subprocess.PIPE,
        env=os.environ | {"OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "0"},
    )
    told = done.stderr.decode(errors="replace")
    (found / "log.txt").write_text(told[-20_000:])
    figures = [(re.findall(pattern, told) or ["?"])[-1] for pattern in STATISTICS.values()]
    coverage, count, size = (PROGRESS.findall(told) or [("?", "?", "?")])[-1]
    kept = [file for file in found.iterdir() if file.suffix not in (".txt", ".dict")]
    findings = str(len(kept)) if figures[0] != "?" or kept else "did not run"
    took_s = f"{time.monotonic() - begin_s:.0f}"
    return [name, figures[0], took_s, coverage, f"{count} ({size})", figures[1], findings]


def main() -> None:
    """Fuzz and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="*", help="names, or parts of them; all if none")
    parser.add_argument("--minutes", type=float, default=30.0, help="for all targets together")
    parser.add_argument("--corpus", type=Path, help="folder to begin with and to keep inputs in")
    parser.add_argument("--found", type=Path, default=Path("out/fuzz"), help="folder of findings")
    flags = parser.parse_args()
    chosen = [n for n in names() if not flags.targets or any(t in n for t in flags.targets)]
    seconds = flags.minutes * 60 / len(chosen)
    with tempfile.TemporaryDirectory() as folder:
        corpora = flags.corpus or Path(folder)
        rows = []
        for name in chosen:
            place = re.sub(r"\W+", "_", name)
            rows.append(fuzz(name, seconds, corpora / place, (flags.found / place).absolute()))
            print(*rows[-1], sep=" | ", flush=True)
    total = sum(int(row[1]) for row in rows if row[1].isdigit())
    header = ["target", "executions", "seconds", "coverage", "corpus", "peak MB", "findings"]
    table = markdown(header, rows)
    past = "\n".join(f"- {regression.name}: {regression.story}" for regression in REGRESSIONS)
    write(
        __file__,
        "Hostile bytes: fuzzing of decoders and file readers",
        INTRODUCTION,
        f"{total:,} executions in {flags.minutes:g} minutes on one core.",
        table,
        "Found by fuzzing and property tests so far, fixed, and kept as a test of its own each:",
        past or "- nothing",
    )


if __name__ == "__main__":
    main()
