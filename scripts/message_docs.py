"""Generate docs/messages.md from the message types and the topic table.

Run `python -m scripts.message_docs` after a change; `--check` only tells whether it is up to date.
"""

import argparse
import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from people4d.codec import MAX_BYTES
from people4d.topics import TOPICS, VERSION, Topic

ROOT = Path(__file__).resolve().parents[1]
SOURCES = tuple(
    ROOT / "people4d" / "messages" / f"{name}.py"
    for name in ("base", "camera", "people", "gait", "score", "status")
)
TEMPLATE = Path(__file__).with_name("message_docs.template.md")
TARGET = ROOT / "docs" / "messages.md"

WORDS = {"int": "int", "float": "float", "str": "text", "bool": "bool", "bytes": "binary"}
ARRAYS = {"U8": "uint8", "U16": "uint16", "F32": "float32", "F64": "float64"}
SHAPE = re.compile(r"(?:\[[^]]*\] )?((?:\d+|[A-Z])(?:x(?:\d+|[A-Z]))*)(?=[\s:,]|$)")
DELIVERY = {
    "newest": "the newest message wins, older ones are dropped and counted",
    "queue": "kept in order",
    "latched": "sent once; late joiners get the last one of each key",
}


class DocsError(Exception):
    """A message is not documented well enough."""


@dataclass(frozen=True)
class Field:
    """One field of a record.

    Args:
        name: Its name on the wire.
        kind: Its type in words.
        presence: "required", or what holds where it is absent.
        comment: Its meaning with unit, shape and frame.
    """

    name: str
    kind: str
    presence: str
    comment: str


@dataclass(frozen=True)
class Record:
    """One message or one part of a message.

    Args:
        name: Name of its class.
        summary: First line of its docstring.
        fields: Its own fields.
    """

    name: str
    summary: str
    fields: tuple[Field, ...]


def read_records(source: str, aliases: dict[str, str]) -> Iterator[Record]:
    """Read the records that a module declares.

    Args:
        source: Text of the module.
        aliases: Types named so far, in words; those of this module are added.

    Raises:
        DocsError: A field has no comment, or an array has no shape in its comment.
    """
    comments = _comments(source)
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Subscript):
            name = ast.unparse(node.targets[0])
            if name not in ARRAYS:
                aliases[name] = _kind(node.value, "", aliases)
        elif isinstance(node, ast.ClassDef):
            summary = (ast.get_docstring(node) or "").partition("\n")[0]
            fields = tuple(_fields(node, comments, aliases))
            if fields:
                yield Record(node.name, summary, fields)


def _comments(source: str) -> dict[int, str]:
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return {t.start[0]: t.string.lstrip("# ") for t in tokens if t.type == tokenize.COMMENT}


def _fields(
    node: ast.ClassDef, comments: dict[int, str], aliases: dict[str, str]
) -> Iterator[Field]:
    for item in node.body:
        if not isinstance(item, ast.AnnAssign) or "ClassVar" in ast.unparse(item.annotation):
            continue
        name = f"{node.name}.{ast.unparse(item.target)}"
        # On its line, or above it where the line is too short.
        comment = comments.get(item.end_lineno or 0) or comments.get(item.lineno - 1)
        if not comment:
            raise DocsError(f"{name}: expected a comment with unit and frame, got none")
        kind = _kind(item.annotation, comment, aliases)
        if "array" in kind and "?" in kind:
            raise DocsError(
                f"{name}: expected a shape such as 17x3 in its comment, got {comment!r}"
            )
        yield Field(name.partition(".")[2], kind, _presence(item.value), comment)


def _kind(hint: ast.expr, comment: str, aliases: dict[str, str]) -> str:
    """Tell a type annotation in words."""
    text = ast.unparse(hint)
    if text in ARRAYS:
        shape = SHAPE.match(comment)
        return f"array {ARRAYS[text]} {shape[1] if shape else '?'}"
    if text in WORDS or text in aliases:
        return WORDS.get(text) or aliases[text]
    if isinstance(hint, ast.BinOp):
        return f"{_kind(hint.left, comment, aliases)} or nil"
    if isinstance(hint, ast.Subscript):
        inner = hint.slice.elts if isinstance(hint.slice, ast.Tuple) else [hint.slice]
        if text.startswith("Literal"):
            return "text: " + ", ".join(ast.unparse(value).strip("'") for value in inner)
        first = _kind(inner[0], comment, aliases)
        if text.startswith("tuple"):
            return f"list of {first}"
        if text.startswith("dict"):
            return f"map of {first} to {_kind(inner[1], comment, aliases)}"
    if isinstance(hint, ast.Name):
        return f"[{text}](#{text.lower()})"
    raise DocsError(f"{text}: expected a type that the wire knows, got another")


def _presence(default: ast.expr | None) -> str:
    if default is None:
        return "required"
    words = {"()": "empty", "None": "nil", "True": "true", "False": "false", "''": "empty"}
    text = ast.unparse(default)
    return words.get(text, "empty" if "default_factory" in text else text.strip("'"))


def generate() -> str:
    """Return the text of docs/messages.md.

    Raises:
        DocsError: A message is not documented well enough.
    """
    aliases: dict[str, str] = {}
    records = [r for path in SOURCES for r in read_records(path.read_text("utf-8"), aliases)]
    by_name = {record.name: record for record in records}
    topics = {topic.message.__name__: topic for topic in TOPICS}
    messages = [_message(by_name[name], topic) for name, topic in topics.items()]
    parts = [_record(r) for r in records if r.name not in topics and r.name != "Message"]
    return TEMPLATE.read_text("utf-8").format(
        version=VERSION,
        max_mib=MAX_BYTES // 2**20,
        topics=_topics(),
        header=_table(by_name["Message"].fields),
        messages="\n".join(messages),
        parts="\n".join(parts),
    )


def _topics() -> str:
    rows = [
        f"| {t.name} | `{t.key}` | [{t.message.__name__}](#{t.message.__name__.lower()}) | "
        f"{f'{t.rate_hz:g} Hz' if t.rate_hz else 'once'} | {t.delivery}, {t.depth} | "
        f"{', '.join(sorted(t.producers))} | "
        f"{'all' if t.readers == '*' else ', '.join(t.readers.split())} |"
        for t in TOPICS
    ]
    head = "| topic | key below the prefix | message | rate | delivery, depth | from | may read |"
    legend = [f"- *{name}*: {meaning}." for name, meaning in DELIVERY.items()]
    return "\n".join([head, "|---|---|---|---|---|---|---|", *rows, "", *legend])


def _message(record: Record, topic: Topic) -> str:
    where = (
        f"Topic **{topic.name}**, key `people4d/{VERSION}/<robot>/{topic.key}`, "
        f"version {topic.message.VERSION}."
    )
    return f"### {record.name}\n\n{record.summary}\n\n{where}\n\n{_table(record.fields)}\n"


def _record(record: Record) -> str:
    return f"### {record.name}\n\n{record.summary}\n\n{_table(record.fields)}\n"


def _table(fields: Sequence[Field]) -> str:
    rows = [f"| `{f.name}` | {f.kind} | {f.presence} | {_escape(f.comment)} |" for f in fields]
    return "\n".join(["| field | type | if absent | meaning |", "|---|---|---|---|", *rows])


def _escape(text: str) -> str:
    """Keep characters that Markdown would read as markup."""
    return re.sub(r"([|<>_*])", r"\\\1", text)


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the file, or check it.

    Returns:
        Exit code: 1 if a message lacks documentation or, with --check, the file is stale.
    """
    parser = argparse.ArgumentParser(description="Generate docs/messages.md.")
    parser.add_argument("--check", action="store_true", help="write nothing; fail if it is stale")
    parser.add_argument("--target", type=Path, default=TARGET, help="file to write or check")
    flags = parser.parse_args(arguments)
    try:
        text = generate()
    except DocsError as error:
        print(f"Messages are not fully documented: {error}.", file=sys.stderr)
        return 1
    if flags.check:
        if flags.target.is_file() and flags.target.read_text("utf-8") == text:
            return 0
        print(f"{flags.target.name} is stale. Run: python -m scripts.message_docs", file=sys.stderr)
        return 1
    flags.target.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
