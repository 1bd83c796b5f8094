"""Tables of measured figures, as Markdown."""

import platform
import subprocess
from collections.abc import Sequence
from datetime import date
from pathlib import Path

import cv2
import numpy as np
import onnxruntime
import psutil

from common.inference.processor import decisive_instructions


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
    """Return the machine and the versions of the measured software, in one line."""
    model = platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [x for x in cpuinfo.read_text().splitlines() if x.startswith("model name")]
        model = names[0].partition(":")[2].strip() if names else model
    versions = {
        "Python": platform.python_version(),
        "onnxruntime": onnxruntime.__version__,
        "OpenCV": cv2.__version__,
        "NumPy": np.__version__,
    }
    named = [f"{name} {version}" for name, version in versions.items()]
    processor = [model, *sorted(decisive_instructions()), f"{psutil.cpu_count()} cores"]
    return ", ".join([*processor, *named, COMMIT])


def commit() -> str:
    """Return commit and date; code, not tables, that differs from it marks the commit."""
    head = _git("rev-parse", "--short=7", "HEAD") or "unknown"
    changed = _git("diff", "--name-only", "HEAD", "--", ":/", ":(top,exclude)*.md")
    return f"commit {head}{'-dirty' if changed else ''}, {date.today().isoformat()}"


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(Path(__file__).parent), *arguments]
    return subprocess.run(command, check=False, capture_output=True, text=True).stdout.strip()


COMMIT = commit()  # version of the loaded code; the files may change during a run


def write(script: str, title: str, *parts: str, dry: bool = False, command: str = "") -> None:
    """Print a report and write it next to its script.

    Args:
        script: `__file__` of the benchmark, or the folder of a package.
        title: First line.
        parts: Paragraphs and tables.
        dry: Whether it is only printed.
        command: Module of the command; empty: the runner with the name of the script.
    """
    made = f"Made by `python -m {command or f'benchmarks {Path(script).stem}'}` on {machine()}."
    text = "\n\n".join([f"# {title}", made, *parts]) + "\n"
    print(text)
    if not dry:
        Path(script).with_suffix(".md").write_text(text, encoding="utf-8")
