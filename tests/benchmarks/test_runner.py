"""The runner of the benchmarks."""

import importlib
import subprocess
import sys

import pytest

from benchmarks.__main__ import GROUPS, run_group
from tests import ROOT

NAMES = [name for group in GROUPS.values() for name in group]
NAMES_MAX = 20


def test_at_most_20_names_in_six_groups() -> None:
    assert len(NAMES) <= NAMES_MAX
    assert len(GROUPS) == 6


@pytest.mark.parametrize("name", NAMES)
def test_benchmark_has_a_main_and_a_committed_table(name: str) -> None:
    assert callable(importlib.import_module(f"benchmarks.{name}").main)
    assert (ROOT / "benchmarks" / f"{name}.md").is_file()


def test_unknown_name_lists_all_and_fails() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks", "unknown"],
        check=False,
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert done.returncode == 1
    assert "Usage: python -m benchmarks NAME" in done.stderr
    assert all(name in done.stdout for name in NAMES)


def test_group_runs_all_its_benchmarks_and_names_those_that_failed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setitem(GROUPS, "pair", {"unknown": "", "own_work": ""})
    assert run_group("pair", ["--help"]) == "failed: unknown"
    assert "own_work, 2 of 2" in capsys.readouterr().out
