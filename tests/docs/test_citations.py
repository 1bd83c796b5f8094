"""Citations in code, settings and pages: each resolves in docs/method.md."""

import re
from collections.abc import Iterator
from pathlib import Path

from tests import ROOT

METHOD = (ROOT / "docs" / "method.md").read_text("utf-8")
KEYS = set(re.findall(r"(?m)^- \[([^\]]+)\] ", METHOD))
SECTIONS = set(re.findall(r"(?m)^## (\d+) ", METHOD))
SECTION = re.compile(r"docs/method\.md,? sections? (\d+)(?:(?: and|,) (\d+))*")
# A name with a year, or one of the keys without: [Bewley 2016], [Zhou 2019a], [PIC4SeR].
KEY = re.compile(
    r"\[((?:[A-Z][\w.\u00c0-\u017f-]+ (?:19|20)\d\d[a-z]?)|PIC4SeR|TrackEval|REP \d+)\]"
)
FOLDERS = (
    "people4d",
    "common",
    "services",
    "cameras",
    "lab",
    "evaluation",
    "deploy",
    "benchmarks",
    "docs",
)


def texts() -> Iterator[tuple[Path, str]]:
    for folder in FOLDERS:
        for pattern in ("*.py", "*.toml", "*.md"):
            for file in (ROOT / folder).rglob(pattern):
                yield file, file.read_text("utf-8")


def test_every_key_is_in_the_bibliography() -> None:
    unknown = {(file.name, key) for file, text in texts() for key in KEY.findall(text)}
    assert {pair for pair in unknown if pair[1] not in KEYS} == set()


def test_every_section_exists() -> None:
    cited = {
        (file.name, number)
        for file, text in texts()
        for numbers in SECTION.findall(re.sub(r"\n\s*#?\s*", " ", text))
        for number in numbers
        if number
    }
    assert cited
    assert {pair for pair in cited if pair[1] not in SECTIONS} == set()


def test_works_are_cited_by_key_and_not_by_a_private_name() -> None:
    private = re.compile(r"method book|the (?:odometry |gait )?(?:paper|thesis)\b", re.IGNORECASE)
    found = [
        (file.name, match[0])
        for file, text in texts()
        for match in private.finditer(text)
        if file.name != "method.md"
    ]
    assert found == []
