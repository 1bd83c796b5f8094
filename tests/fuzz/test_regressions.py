"""Findings of fuzzing stay fixed, and its seeds are valid."""

import contextlib
from pathlib import Path

import pytest

from people4d.errors import People4dError
from tests.fuzz.regressions import REGRESSIONS
from tests.fuzz.targets import groups

TARGETS = {name: target for group in groups() for name, target in group.items()}


@pytest.mark.parametrize("name", TARGETS)
def test_seeds_of_each_target_are_read_or_refused(name: str, tmp_path: Path) -> None:
    target = TARGETS[name]
    (tmp_path / "made").mkdir()
    (tmp_path / "read").mkdir()
    seeds = target.seeds(tmp_path / "made")
    assert seeds
    for seed in seeds:
        assert len(seed) <= target.max_bytes
        # Not all are accepted: an example of a frame holds no image.
        with contextlib.suppress(People4dError):
            target.read(seed, tmp_path / "read")


@pytest.mark.parametrize("number", range(len(REGRESSIONS)))
def test_former_failure_is_refused_or_read(number: int, tmp_path: Path) -> None:
    found = REGRESSIONS[number]
    (tmp_path / "made").mkdir()
    data = found.make(tmp_path / "made")
    (tmp_path / "read").mkdir()
    with contextlib.suppress(People4dError):
        TARGETS[found.name].read(data, tmp_path / "read")
