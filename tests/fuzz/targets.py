"""All targets of fuzzing by name."""

import importlib
from collections.abc import Iterator

from tests.fuzz.target import Target

MODULES = ("messages", "files", "state", "clients", "sequences")  # each with its TARGETS


def groups() -> Iterator[dict[str, Target]]:
    """Yield the targets of one module after the other; each is imported on its turn."""
    for name in MODULES:
        targets: tuple[Target, ...] = importlib.import_module(f"tests.fuzz.{name}").TARGETS
        yield {target.name: target for target in targets}


def find(name: str) -> Target:
    """Return the target of a name."""
    return next(group[name] for group in groups() if name in group)
