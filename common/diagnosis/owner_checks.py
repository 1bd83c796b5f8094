"""Checks of messages from a process that is not their owner."""

from collections.abc import Iterator

from common.diagnosis.evidence import Diagnostic, Evidence, warning
from common.text import listed
from people4d.ownership import FOREIGN


def owners(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that only their owners send calibrations, transforms, zones and truth."""
    found: dict[str, set[str]] = {}
    for name, vitals in evidence.vitals.items():
        for counter, count in vitals.last.counters.items():
            if counter.startswith(f"{FOREIGN}_") and count:
                found.setdefault(name, set()).add(counter.removeprefix(f"{FOREIGN}_"))
    if found:
        topics = ", ".join(sorted(set().union(*found.values())))
        what = f"another process than the owner sends {topics}, refused by {listed(sorted(found))}"
        hint = "End that process; people4d keys makes keys, with which nothing else may send it."
        about = (name for name in found if _is_explained(evidence.vitals[name].fault))
        yield warning("owners", what, hint, *about)


def _is_explained(fault: str) -> bool:
    """Check that refused messages are the only fault of a process."""
    return all("another process sends" in part for part in fault.split("; "))
