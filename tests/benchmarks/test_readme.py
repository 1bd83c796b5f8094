"""Figures of README, from tables that are as new as their code."""

from pathlib import Path

import pytest

from benchmarks import readme
from benchmarks.readme import Row, Table
from scripts import table_age
from tests import ROOT
from tests.scripts.test_table_age import repository

__all__ = ["repository"]  # a fixture

FIGURES = """
## filinha

| method | identity % | |
| --- | --- | --- |
| MoveNet, appearance (default) | 94.3 [90.0, 98.6] | a |
| MoveNet, detections alone | - | b |
| MoveNet, other 1.0: own settings | 42.0 [30.1, 53.9] | c |
| MoveNet, another 2.0: gate 0.0 | 78.0 [70.5, 85.5] | d |

## felix

| method | identity % | |
| --- | --- | --- |
| MoveNet, appearance (default) | 4.0 [2.0, 6.0] | e |
| MoveNet, another 2.0: gate 0.0 | 99.0 [98.0, 100.0] | f |
"""


MEASURED = "identity correct in 94.3 [90.0, 98.6] %; best other package 78.0 [70.5, 85.5] %"


@pytest.fixture
def table(repository: Path) -> Path:
    """Table as new as its code, from which README has one figure."""
    path = repository / "benchmarks" / "own.md"
    path.write_text(path.read_text() + FIGURES)
    return path


def test_row_equals_the_figures_of_its_table(table: Path) -> None:
    text = readme.real_people(Table(table))
    assert text == MEASURED


def test_cell_is_found_by_section_and_label(table: Path) -> None:
    default = "MoveNet, appearance (default)"
    assert Table(table).cell("identity", default, section="felix") == "4.0 [2.0, 6.0]"
    with pytest.raises(LookupError, match=r"own.md has no 'yaw'"):
        Table(table).cell("yaw", default)


def test_figure_of_an_older_table_disappears(table: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(readme, "ROWS", (Row("identity", "own", readme.real_people),))
    assert f"| identity ([own](benchmarks/own.md)) | {MEASURED} |" in readme.block()
    (table.parents[1] / "people4d" / "code.py").write_text("def f(x):\n    return x + 1\n")
    older = "Outdated tables, not shown here: [own](benchmarks/own.md)."
    assert readme.block() == f"{readme.BEGIN}\n{older}\n{readme.END}"


def test_check_fails_if_the_block_differs(table: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(readme, "ROWS", (Row("identity", "own", readme.real_people),))
    page = table.parents[1] / "README.md"
    page.write_text(f"# Title\n\n{readme.BEGIN}\n{readme.END}\n")
    monkeypatch.setattr("sys.argv", ["readme"])
    readme.main()
    assert "94.3 [90.0" in page.read_text()
    monkeypatch.setattr("sys.argv", ["readme", "--check"])
    readme.main()
    page.write_text(page.read_text().replace("94.3", "95.3"))
    with pytest.raises(SystemExit, match="differs from the tables"):
        readme.main()


def test_readme_has_the_block_of_figures() -> None:
    assert readme.BLOCK.search((ROOT / "README.md").read_text("utf-8"))


def test_rows_name_benchmarks_with_a_table() -> None:
    for row in readme.ROWS:
        assert table_age.file_of(f"benchmarks.{row.table}")
        assert (ROOT / "benchmarks" / f"{row.table}.md").is_file()
