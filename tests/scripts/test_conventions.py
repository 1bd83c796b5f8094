"""Sizes of the code base."""

import pytest

from scripts.conventions import numeric_constants, print_counts

MODULE = """
A = 1.5  # one
B, C = 2, 3  # two
D: float = -4
NAMES = {"x": (5, 6)}
TEXT = "7"
FLAG = True
lower = 8
TABLE: int
def f():
    INNER = 9
"""


def test_constants_are_upper_case_names_with_a_number_in_their_value() -> None:
    assert numeric_constants(MODULE) == 5  # A, B, C, D and NAMES


def test_counts_name_settings_constants_commands_and_words(
    capsys: pytest.CaptureFixture[str],
) -> None:
    print_counts([])
    sizes = [line.rsplit(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
    found = {name: int(size) for name, size in sizes if size.isdigit()}
    for name in ("settings", "numeric constants of product", "commands of people4d", "benchmarks"):
        assert found[name] > 10
    assert found["words of Markdown"] > 10_000
