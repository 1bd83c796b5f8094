"""The threat model in SECURITY.md: each row is shown by tests that exist."""

import ast
import re

from tests import ROOT

SECTION = (ROOT / "SECURITY.md").read_text("utf-8").partition("## Who may do what")[2]
ROWS = [
    [cell.strip() for cell in line.strip("| ").split(" | ")]
    for line in SECTION.partition("\n## ")[0].splitlines()
    if line.startswith("| ") and not line.startswith(("| attacker", "| ---"))
]
TEST = re.compile(r"`(tests/[\w/]+\.py)::(test_\w+)`")


def test_every_row_names_tests_that_exist() -> None:
    assert len(ROWS) > 15
    for row in ROWS:
        named = TEST.findall(row[-1])
        assert named, row
        for file, name in named:
            tree = ast.parse((ROOT / file).read_text("utf-8"))
            functions = {n.name for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)}
            assert name in functions, f"{file}::{name}"


def test_rows_cover_attackers_without_keys_and_with_those_of_each_role() -> None:
    attackers = " ".join(row[0] for row in ROWS if len(row) == 4)
    for attacker in ("without keys, system without keys", "planner's key", "service's key"):
        assert attacker in attackers
