"""Tables that are older than the code that they measure."""

import ast
import re
import subprocess
from pathlib import Path

import pytest

from benchmarks.lib.table import write
from common.inference.processor import decisive_instructions
from scripts import table_age
from tests import ROOT

BEFORE = '"""Doc."""\n\n\ndef f(x):\n    """Doc."""\n    return x  # comment\n'
TABLE = "# Table\n\nMade by `python -m benchmarks own` on a machine, commit {}, 2026-01-01.\n"


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Repository of a benchmark with code imported and started, and a table of its commit."""
    monkeypatch.setattr(table_age, "ROOT", tmp_path)
    for folder in ("people4d", "benchmarks", "services", "models"):
        (tmp_path / folder).mkdir()
    own = 'STARTS = ("services.one",)\n\n\ndef main():\n    import people4d.code\n'
    (tmp_path / "benchmarks" / "own.py").write_text(own)
    for file in ("people4d/code.py", "services/one.py", "services/other.py"):
        (tmp_path / file).write_text(BEFORE)
    subprocess.run(["git", "-C", str(tmp_path), "init", "-q"], check=True)
    (tmp_path / "benchmarks" / "own.md").write_text(TABLE.format(committed(tmp_path)))
    return tmp_path


def committed(repository: Path) -> str:
    """Commit all files; return the commit."""
    for command in (
        ("add", "."),
        ("-c", "user.name=x", "-c", "user.email=x@x", "commit", "-qm", "x"),
    ):
        subprocess.run(["git", "-C", str(repository), *command], check=True)
    return (table_age.git("rev-parse", "--short", "HEAD") or "").strip()


@pytest.mark.parametrize("file", ["people4d/code.py", "services/one.py"])
@pytest.mark.parametrize(
    ("code", "expected"),
    [
        (BEFORE, ""),
        (BEFORE.replace("Doc.", "Other words.").replace("# comment", ""), ""),
        (BEFORE.replace("return x", "return x + 1"), "1 files since"),
    ],
)
def test_table_is_older_than_changed_code_only(
    repository: Path, file: str, code: str, expected: str
) -> None:
    (repository / file).write_text(code)
    assert table_age.age(repository / "benchmarks" / "own.md").startswith(expected)
    assert bool(table_age.age(repository / "benchmarks" / "own.md")) == bool(expected)


def test_code_that_is_not_imported_ages_no_table(repository: Path) -> None:
    (repository / "services" / "other.py").unlink()
    assert not table_age.age(repository / "benchmarks" / "own.md")


@pytest.mark.parametrize(("function", "expected"), [("write", ""), ("spread", "1 files since")])
def test_layout_of_a_table_ages_none(
    repository: Path, monkeypatch: pytest.MonkeyPatch, function: str, expected: str
) -> None:
    file, table = "people4d/code.py", repository / "benchmarks" / "own.md"
    monkeypatch.setattr(table_age, "LAYOUT", {file: ("write",)})
    (repository / file).write_text(BEFORE + f"\n\ndef {function}():\n    pass\n")
    assert table_age.age(table).startswith(expected)
    assert bool(table_age.age(table)) == bool(expected)


def test_preset_ages_tables_if_a_value_changes(
    repository: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table_age, "DATA", {"people4d/code.py": "models"})
    preset, table = repository / "models" / "one.toml", repository / "benchmarks" / "own.md"
    preset.write_text("x = 1  # comment\n")
    table.write_text(TABLE.format(committed(repository)))
    preset.write_text("x = 1\n")
    assert not table_age.age(table)
    preset.write_text("x = 2\n")
    assert "models/one.toml" in table_age.age(table)


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


@pytest.mark.parametrize(
    ("start", "file"),
    [
        ("benchmarks.together", "services/tracker/node.py"),
        ("benchmarks.together", "services/router/__main__.py"),
        ("benchmarks.together", "models"),
        ("benchmarks.faults", "deploy/launcher/prefork.py"),
        ("benchmarks.scoreboard", "services/presets/*.toml"),
        ("tests.fuzz.__main__", "services/camera/recording.py"),
    ],
)
def test_table_depends_on_what_its_benchmark_imports_and_starts(start: str, file: str) -> None:
    assert file in table_age.paths(start)


def test_written_table_names_its_commit_and_the_instructions_that_decide(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(str(tmp_path / "own_work.py"), "Title", "Part.")
    text = (tmp_path / "own_work.md").read_text("utf-8")
    assert table_age.MADE.search(text)
    assert all(f", {name}, " in text for name in decisive_instructions())
    assert capsys.readouterr().out == f"{text}\n"


def test_module_that_starts_processes_names_them() -> None:
    files = [*(ROOT / "benchmarks").rglob("*.py")]
    starting = [f for f in files if "sys.executable" in f.read_text() or "SCRIPT)" in f.read_text()]
    runner = ROOT / "benchmarks" / "__main__.py"
    named = [f for f in starting if f != runner]
    assert len(named) >= 4
    for file in named:
        (started,) = re.findall(r"(?ms)^STARTS = (\(.*?\))$", file.read_text())
        assert all(map(table_age.file_of, ast.literal_eval(started))), file


def test_command_with_an_option_and_its_number_is_read() -> None:
    made = table_age.MADE.search(
        "Made by `python -m benchmarks objects --views 60` on a processor, commit 5423e7f, 2026."
    )
    assert made is not None
    assert (made["module"], made["name"], made["commit"]) == ("benchmarks", " objects", "5423e7f")
