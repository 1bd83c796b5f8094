"""The documentation of the messages is complete and up to date."""

from pathlib import Path
from typing import Annotated, ClassVar, Literal

import msgspec
import pytest

from people4d.messages import U16, Track
from people4d.messages.base import Keypoints, Ratio
from people4d.topics import TOPICS
from people4d.validation import Shape
from scripts.message_docs import DocsError, fields_of, generate, main


def test_committed_file_is_up_to_date() -> None:
    assert main(["--check"]) == 0


def test_a_stale_or_absent_file_is_reported_in_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "messages.md"
    for _ in range(2):
        assert main(["--check", "--target", str(target)]) == 1
        hint = "messages.md is stale. Run: python -m scripts.message_docs\n"
        assert capsys.readouterr().err == hint
        target.write_text(generate() + "x")
    assert main(["--target", str(target)]) == 0
    assert main(["--check", "--target", str(target)]) == 0


def test_every_topic_and_message_is_documented() -> None:
    text = generate()
    for topic in TOPICS:
        assert f"`{topic.key}`" in text
        assert f"### {topic.message.__name__}\n" in text
        for field in topic.message.__struct_fields__:
            assert f"\n- `{field}` (" in text


class Undocumented(msgspec.Struct):
    a: int  # fine

    b: int


class Unknown(msgspec.Struct):
    a: list[complex]  # numbers


class Documented(msgspec.Struct):
    """Summary.

    More.
    """

    VERSION: ClassVar[int] = 1

    e: Annotated[U16, Shape("N", "D")]  # [m] each
    a: Keypoints | None = None  # [px] u, v
    b: tuple[Track, ...] = ()  # parts
    # on: a first line,
    # and a second one
    c: Literal["on", "off"] = "on"
    d: dict[str, Ratio] = msgspec.field(default_factory=dict)  # by name


def test_a_field_without_a_comment_is_refused() -> None:
    with pytest.raises(DocsError, match=r"Undocumented\.b: expected a comment .*, got none"):
        list(fields_of(Undocumented))


def test_a_type_the_wire_does_not_have_is_refused() -> None:
    with pytest.raises(DocsError, match="complex"):
        list(fields_of(Unknown))


def test_types_are_named_in_plain_words() -> None:
    assert list(fields_of(Documented)) == [
        ("e", "array uint16 NxD", "required", "[m] each"),
        ("a", "array float32 17x3 +-1e+06 or nil", "nil", "[px] u, v"),
        ("b", "list of [Track](#track)", "empty", "parts"),
        ("c", "text: on, off", "on", "on: a first line, and a second one"),
        ("d", "map of text to float 0 to 1", "empty", "by name"),
    ]
