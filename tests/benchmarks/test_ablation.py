"""Verdicts of the ablation, on manually written units."""

import subprocess

import numpy as np

from benchmarks.ablation import REAL, deleted, methods, table, verdicts
from benchmarks.lib.ablation.parts import DELETED, PARTS, Part
from people4d.messages import F64
from tests import ROOT

PART = Part(("tracker.yaw=kalman",))
PUBLISHED = Part(("tracker.yaw=kalman",), "IMM [Blom 1988]")


def events(*rights: float) -> F64:
    """Return events with ten annotations, `right` of them correct, and all else perfect."""
    return np.array([[(right, 10.0), (10.0, 10.0), (0.0, 10.0)] for right in rights])


def verdict(part: Part, *rights: float) -> list[str]:
    """Return the cells of the verdict on a part without which so many are right."""
    units = {"best": events(8, 9, 8), "rule": events(*rights)}
    table = verdicts({"rule": part}, {"real": (units, REAL)})
    return [cell.strip() for cell in table.splitlines()[-1].strip("|").split("|")]


def test_part_without_which_every_event_is_worse_stays() -> None:
    stays = "kept, because without it worse: identity % (real)"
    assert verdict(PART, 5, 6, 5) == ["rule", stays, "-"]


def test_part_without_which_every_event_is_better_does_not_stay() -> None:
    assert verdict(PART, 9, 10, 9) == ["rule", "no figure is worse", "identity % (real)"]


def test_part_without_effect_stays_if_it_is_published() -> None:
    assert verdict(PART, 8, 9, 8)[1] == "no figure is worse"
    assert verdict(PUBLISHED, 8, 9, 8)[1] == "published method: IMM [Blom 1988]"


def test_settings_of_all_parts_are_known() -> None:
    assert len(methods(PARTS)) == len(PARTS) + 1


def test_figure_that_no_event_changes_is_shown_as_0() -> None:
    units = {"best": events(8, 9, 8), "rule": events(5, 9, 8)}
    cells = table(units, REAL).splitlines()[-1].strip("| ").split(" | ")
    assert cells[0] == "without rule"
    assert cells[1].startswith("-10.0 [")  # 3 of 30 annotations
    assert cells[2:] == ["0", "0"]


def test_every_deleted_rule_is_listed_with_its_commit_and_reason() -> None:
    rows = [line.split("|") for line in deleted().splitlines()[2:]]
    assert len(rows) == sum(map(len, DELETED.values()))
    for _, rule, commit, why, _ in rows:
        subprocess.run(["git", "cat-file", "-e", commit.strip()], cwd=ROOT, check=True)
        assert rule.strip() not in PARTS
        assert why.strip()
