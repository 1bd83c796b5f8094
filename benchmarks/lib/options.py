"""Options that several benchmarks share."""

import argparse
from pathlib import Path
from typing import Any

from evaluation.cache import default_folder

ROOT = Path(__file__).resolve().parents[2]
SHARED: dict[str, dict[str, Any]] = {
    "shared": {"type": Path, "default": ROOT.parent / "shared", "help": "folder of reference data"},
    "jobs": {"type": int, "default": 2, "help": "processes at once"},
    "cache": {
        "type": Path,
        "default": default_folder(),
        "help": "folder of renderings and detections",
    },
    "rounds": {"type": int, "default": 3, "help": "rounds in turns: median, least and most"},
    "quick": {"action": "store_true", "help": "less of everything; nothing is written"},
    "dry": {"action": "store_true", "help": "print the table, do not write it"},
}


def parser(description: str | None, *shared: str) -> argparse.ArgumentParser:
    """Return a parser with shared options; its help begins with the docstring's first paragraph."""
    made = argparse.ArgumentParser(description=(description or "").partition("\n\n")[0])
    for name in shared:
        made.add_argument(f"--{name}", **SHARED[name])
    return made
