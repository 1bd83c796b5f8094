"""Code blocks and commands of the documentation."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests import ROOT

PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
FENCE = re.compile(
    r"(?:<!-- (?P<directive>not run|setup):\s(?P<text>(?:(?!-->).)*)-->\n+)?"
    r"^```(?P<language>\S*)(?P<info>[^\n]*)\n(?P<code>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
SPAN = re.compile(r"(?<!`)`([^`]+)`(?!`)")
COMMAND = re.compile(
    r"(?:^|\s)(?:\S*/)?(people4d|python -m|make) ((?:\"[^\"]*\"|[^|;&\"])*)", re.DOTALL
)
ENDINGS = ("|", "&&", ";", "&", ">", "...")


@dataclass(frozen=True)
class Block:
    """A fenced block of a page.

    Args:
        page: The page.
        line: Line of the fence, from 1.
        language: Language of the fence.
        info: Text behind the language, for example "on=nuc".
        code: Its text.
        reason: Reason why it is not run, of `<!-- not run: reason -->` before it; empty: it is run.
        setup: Python code that runs before it, of `<!-- setup: code -->`.
    """

    page: Path
    line: int
    language: str
    info: str
    code: str
    reason: str = ""
    setup: str = ""

    @property
    def name(self) -> str:
        """Page and line, for messages and names of tests."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"


@dataclass(frozen=True)
class Command:
    """A command in a page."""

    name: str
    program: str
    arguments: tuple[str, ...]
    complete: bool


def blocks(*languages: str) -> list[Block]:
    """Return the fenced blocks of all pages, of some languages or of all."""
    found = [block for page in PAGES for block in _blocks(page)]
    return [block for block in found if not languages or block.language in languages]


def commands() -> list[Command]:
    """Return the commands in indented lines, shell blocks and code spans of all pages."""
    found = []
    for page in PAGES:
        text = page.read_text("utf-8")
        code = [(b.line, line) for b in _blocks(page) if b.language == "sh" for line in _joined(b)]
        prose = FENCE.sub(lambda match: "\n" * match[0].count("\n"), text)
        lines = list(enumerate(re.sub(r"\\\n", "   ", prose).splitlines(), 1))
        code += [(number, line) for number, line in lines if line.startswith("    ")]
        spans = [
            (prose.count("\n", 0, match.start()) + 1, match[1].replace("\n", " "))
            for match in SPAN.finditer(prose)
            if not match[1].endswith(".")  # a sentence that is quoted
        ]
        found += [c for n, line in code for c in _command(page, n, line, complete=True)]
        found += [c for n, line in spans for c in _command(page, n, line, complete=False)]
    return found


def _blocks(page: Path) -> Iterator[Block]:
    text = page.read_text("utf-8")
    for match in FENCE.finditer(text):
        yield Block(
            page=page,
            line=text.count("\n", 0, match.start("language")) + 1,
            language=match["language"],
            info=match["info"].strip(),
            code=match["code"],
            reason=match["text"] if match["directive"] == "not run" else "",
            setup=match["text"] if match["directive"] == "setup" else "",
        )


def _joined(block: Block) -> list[str]:
    return re.sub(r"\\\n", " ", block.code).splitlines()


def _command(page: Path, line: int, text: str, complete: bool) -> Iterator[Command]:
    match = COMMAND.match(text) if not complete else COMMAND.search(text.split(" #")[0])
    if match:
        words = []
        for word in shlex.split(match[2], comments=True):
            if word in ENDINGS:
                break
            words.append(word)
        name = f"{page.relative_to(ROOT)}:{line}: {match[1]} {shlex.join(words)}"
        yield Command(name, match[1], tuple(words), complete)
