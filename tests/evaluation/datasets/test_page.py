"""The page of the data sets holds a row of each record."""

import pytest

from evaluation.datasets.registry import DATASETS, find_dataset
from people4d.errors import ConfigError
from tests import ROOT

PAGE = ROOT / "docs" / "operation" / "datasets.md"


def row(name: str) -> str:
    one = find_dataset(name)
    cells = [f"`{name}`", f"[{one.title}]({one.layout}), {one.licence}", one.metric]
    cells += [", ".join(f"`{pattern}`" for pattern in one.tuning) or "none"]
    return f"| {' | '.join(cells)} |"


def test_table_of_the_page_equals_the_records() -> None:
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    start = lines.index("| --- | --- | --- | --- |") + 1
    rows = [row(name) for name in DATASETS]
    assert lines[start : start + len(rows)] == rows, "\n".join(["expected", *rows])
    assert not lines[start + len(rows)].startswith("|")


def test_unknown_data_set_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"'mot99' is unknown.*mot17"):
        find_dataset("mot99")
