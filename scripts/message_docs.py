"""Generate docs/development/messages.md from the message types and the topic table.

Run `python -m scripts.message_docs` after a change; `--check` only fails if it is stale.
"""

import argparse
import importlib
import inspect
import re
import sys
import types
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np

from common.field_comments import field_comments
from people4d.messages import Message
from people4d.messages.base import NAME_FORM, Name, Record
from people4d.topics import IMAGE_MAX_BYTES, OTHER_MAX_BYTES, TOPICS, VERSION, Topic
from people4d.validation import Magnitude, Shape, range_text

SOURCES = (
    "base",
    "camera",
    "people",
    "areas",
    "gait",
    "prediction",
    "events",
    "score",
    "skeleton",
    "status",
    "target",
)
TEMPLATE = Path(__file__).with_name("message_docs.template.txt")
TARGET = Path(__file__).resolve().parents[1] / "docs" / "development" / "messages.md"

WORDS = {int: "int", float: "float", str: "text", bool: "bool", bytes: "binary", Name: "name"}
DELIVERY = {
    "newest": "the newest message wins, older ones are dropped and counted",
    "queue": "queued in order",
    "latched": "sent once, and repeated by its owner; late joiners get the last one of each key",
}


class DocsError(Exception):
    """Incomplete documentation of a message."""


class FieldDocs(NamedTuple):
    """One field of a record.

    Args:
        name: Name on the wire.
        kind: Type in words.
        presence: "required", or the value of an absent field.
        comment: Meaning with unit and frame.
    """

    name: str
    kind: str
    presence: str
    comment: str


def fields_of(record: type[msgspec.Struct]) -> Iterator[FieldDocs]:
    """Describe the fields of a record type, without inherited ones.

    Raises:
        DocsError: A field has no comment, or an unknown type.
    """
    comments = field_comments(record)
    hints = get_type_hints(record, include_extras=True)
    for field in msgspec.structs.fields(record):
        if field.name in inspect.get_annotations(record):
            comment = comments[field.name]
            if not comment:
                name = f"{record.__name__}.{field.name}"
                raise DocsError(f"{name}: expected a comment with unit and frame, got none")
            yield FieldDocs(field.name, _kind(hints[field.name]), _presence(field), comment)


def _kind(hint: Any) -> str:
    """Describe a type in words."""
    origin, arguments = get_origin(hint), get_args(hint)
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        return f"[{hint.__name__}](#{hint.__name__.lower()})"
    if hint in WORDS:
        return WORDS[hint]
    if origin is Annotated:
        return _annotated(*arguments)
    if origin is Literal:
        return "text: " + ", ".join(arguments)
    if origin in (Union, types.UnionType):
        names = ["nil" if kind is types.NoneType else _kind(kind) for kind in arguments]
        return " or ".join(names)
    if origin is tuple:
        return f"list of {_kind(arguments[0])}"
    if origin is dict:
        return f"map of {_kind(arguments[0])} to {_kind(arguments[1])}"
    if origin is np.ndarray:
        return f"array {np.dtype(get_args(arguments[1])[0]).name}"
    raise DocsError(f"{hint}: expected a type that the wire has, got another")


def _annotated(kind: Any, *extras: Any) -> str:
    words = _kind(kind)
    for extra in extras:
        if isinstance(extra, Shape | Magnitude):
            words += f" {extra}"
        elif isinstance(extra, msgspec.Meta) and kind in (int, float):
            words += f" {range_text([extra])}"
    return words


def _presence(field: msgspec.structs.FieldInfo) -> str:
    if field.required:
        return "required"
    if field.default is msgspec.NODEFAULT or field.default in ((), ""):
        return "empty"
    return "nil" if field.default is None else str(field.default).lower()


def generate() -> str:
    """Return the text of docs/development/messages.md.

    Raises:
        DocsError: The documentation of a message is incomplete.
    """
    topics = {topic.message: topic for topic in TOPICS}
    parts = [
        record
        for name in SOURCES
        for record in vars(importlib.import_module(f"people4d.messages.{name}")).values()
        if isinstance(record, type)
        and issubclass(record, msgspec.Struct)
        and record.__module__ == f"people4d.messages.{name}"
        and record not in (*topics, Message, Record)
    ]
    versions = [f'"{m.__name__}": {m.VERSION}' for m in topics if m.VERSION > 1]
    return TEMPLATE.read_text("utf-8").format(
        version=VERSION,
        image_max_mib=IMAGE_MAX_BYTES // 2**20,
        other_max_mib=OTHER_MAX_BYTES // 2**20,
        name_form=NAME_FORM,
        versions=", ".join(versions),
        topics=_topics(),
        header=_list(Message),
        messages="\n".join(_section(message, topic) for message, topic in topics.items()),
        parts="\n".join(_section(part) for part in parts),
    )


def _topics() -> str:
    rows = [
        f"| [{t.name}](#{t.message.__name__.lower()}) | `{t.key}` | "
        f"{f'{t.rate_hz:g} Hz' if t.rate_hz else 'once'} | {t.delivery}, {t.depth} | "
        f"{', '.join(sorted(t.producers))} | "
        f"{'yes' if {'*', 'planner'} & set(t.readers.split()) else '-'} |"
        for t in TOPICS
    ]
    head = "| topic | key below the prefix | rate | delivery, depth | from | planner |"
    legend = [f"- *{name}*: {meaning}." for name, meaning in DELIVERY.items()]
    return "\n".join([head, "|---|---|---|---|---|---|", *rows, "", *legend])


def _section(record: type[msgspec.Struct], topic: Topic | None = None) -> str:
    version = f", version {topic.message.VERSION}" if topic and topic.message.VERSION > 1 else ""
    where = f"Topic **{topic.name}**{version}.\n\n" if topic else ""
    summary = (record.__doc__ or "").partition("\n")[0]
    return f"### {record.__name__}\n\n{summary}\n\n{where}{_list(record)}\n"


def _list(record: type[msgspec.Struct]) -> str:
    return "\n".join(
        f"- `{f.name}` ({_type_and_default(f)}): "
        f"{_escape(f.comment.removesuffix('; absent if unknown'))}"
        for f in fields_of(record)
    )


def _type_and_default(field: FieldDocs) -> str:
    """Return the type, and the value of an absent field."""
    optional = {"required": "", "nil": ", optional", "empty": ", optional"}
    default = optional.get(field.presence, f", default {field.presence}")
    kind = field.kind.removesuffix(" or nil") if field.presence == "nil" else field.kind
    return (kind if kind[0] == "[" else _escape(kind)) + default


def _escape(text: str) -> str:
    """Escape characters that are markup in Markdown."""
    return re.sub(r"([|<>_*])", r"\\\1", text)


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the file, or check it.

    Returns:
        Exit code: 1 if a message lacks documentation or, with --check, the file is stale.
    """
    parser = argparse.ArgumentParser(description="Generate docs/development/messages.md.")
    parser.add_argument("--check", action="store_true", help="write nothing; fail if it is stale")
    parser.add_argument("--target", type=Path, default=TARGET, help="file to write or check")
    flags = parser.parse_args(arguments)
    try:
        text = generate()
    except DocsError as error:
        print(f"Messages are not fully documented: {error}.", file=sys.stderr)
        return 1
    if not flags.check:
        flags.target.write_text(text, encoding="utf-8")
    elif not flags.target.is_file() or flags.target.read_text("utf-8") != text:
        print(f"{flags.target.name} is stale. Run: python -m scripts.message_docs", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
