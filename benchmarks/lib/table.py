"""Tables of measured figures, as Markdown."""

import platform
import subprocess
from collections.abc import Sequence
from datetime import date
from pathlib import Path

import numpy as np
import psutil


def spread(values: Sequence[float], form: str = "{:.2f}") -> str:
    """Return the median, with minimum and maximum of several rounds, as text."""
    if len(values) == 1:
        return form.format(values[0])
    low, middle, high = min(values), float(np.median(values)), max(values)
    return f"{form.format(middle)} ({form.format(low)} to {form.format(high)})"


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def machine() -> str:
    """Return the machine and the version of the code, in one line."""
    model = platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [x for x in cpuinfo.read_text().splitlines() if x.startswith("model name")]
        model = names[0].partition(":")[2].strip() if names else model
    return f"{model}, {psutil.cpu_count()} cores, Python {platform.python_version()}, {commit()}"


def commit() -> str:
    """Return the commit, marked if the tree has changes, and today's date."""
    folder = Path(__file__).parent
    git = ("git", "-C", str(folder), "describe", "--always", "--dirty", "--abbrev=7")
    done = subprocess.run(git, check=False, capture_output=True, text=True)
    return f"commit {done.stdout.strip() or 'unknown'}, {date.today().isoformat()}"


def write(script: str, title: str, *parts: str) -> None:
    """Print a report and write it next to its script.

    Args:
        script: `__file__` of the benchmark.
        title: First line.
        parts: Paragraphs and tables.
    """
    command = f"`python -m benchmarks {Path(script).stem}`"
    text = "\n\n".join([f"# {title}", f"Made by {command} on {machine()}.", *parts]) + "\n"
    print(text)
    Path(script).with_suffix(".md").write_text(text, encoding="utf-8")
