"""The threat model in SECURITY.md: each attempt is shown by tests that exist."""

import ast
import re

from tests import ROOT

SECTION = (ROOT / "SECURITY.md").read_text("utf-8").partition("## Who may do what")[2]
ROWS = [
    line for line in SECTION.partition("\n## ")[0].splitlines() if line.startswith(("- ", "**"))
]
ATTEMPTS = [row for row in ROWS if row.startswith("- ")]
TEST = re.compile(r"`(tests/[\w/]+\.py)::(test_\w+)`")


def test_every_attempt_names_tests_that_exist() -> None:
    assert len(ATTEMPTS) > 15
    for row in ATTEMPTS:
        named = TEST.findall(row)
        assert named, row
        for file, name in named:
            tree = ast.parse((ROOT / file).read_text("utf-8"))
            functions = {n.name for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)}
            assert name in functions, f"{file}::{name}"


def test_rows_cover_attackers_without_keys_and_with_those_of_each_role() -> None:
    attackers = " ".join(row for row in ROWS if row.startswith("**")).lower()
    for attacker in ("without keys, system without keys", "planner's key", "service's key"):
        assert attacker in attackers
