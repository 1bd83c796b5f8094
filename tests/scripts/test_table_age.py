"""Tables that are older than the code that they measure."""

import subprocess
from pathlib import Path

import pytest

from scripts import table_age

BEFORE = '"""Doc."""\n\n\ndef f(x):\n    """Doc."""\n    return x  # comment\n'
TABLE = "# Table\n\nMade by `python -m benchmarks own` on a machine, commit {}, 2026-01-01.\n"


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Repository of one file of code, committed, and a table that names its commit."""
    monkeypatch.setattr(table_age, "ROOT", tmp_path)
    for folder in ("people4d", "benchmarks"):
        (tmp_path / folder).mkdir()
    (tmp_path / "people4d" / "code.py").write_text(BEFORE)
    for command in (
        ("init", "-q"),
        ("add", "."),
        ("-c", "user.name=x", "-c", "user.email=x@x", "commit", "-qm", "x"),
    ):
        subprocess.run(["git", "-C", str(tmp_path), *command], check=True)
    commit = (table_age.git("rev-parse", "--short", "HEAD") or "").strip()
    (tmp_path / "benchmarks" / "own.md").write_text(TABLE.format(commit))
    return tmp_path


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        (BEFORE, ""),
        (BEFORE.replace("Doc.", "Other words.").replace("# comment", ""), ""),
        (BEFORE.replace("return x", "return x + 1"), "1 files since"),
        (None, "1 files since"),
    ],
)
def test_table_is_older_than_changed_code_only(
    repository: Path, code: str | None, expected: str
) -> None:
    file = repository / "people4d" / "code.py"
    if code is None:
        file.unlink()
    else:
        file.write_text(code)
    assert table_age.age(repository / "benchmarks" / "own.md").startswith(expected)
    assert bool(table_age.age(repository / "benchmarks" / "own.md")) == bool(expected)


@pytest.mark.parametrize(
    ("commit", "expected"),
    [("0" * 7, "commit 0000000 is not known here"), ("none", "names no commit")],
)
def test_table_without_a_known_commit_is_older(
    repository: Path, commit: str, expected: str
) -> None:
    table = repository / "benchmarks" / "own.md"
    table.write_text(TABLE.format(commit))
    assert table_age.age(table) == expected
