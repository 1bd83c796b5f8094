"""The documentation of the messages is whole and up to date."""

from pathlib import Path

import pytest

from people4d.topics import TOPICS
from scripts.message_docs import DocsError, generate, main, read_records


def test_the_committed_file_is_up_to_date() -> None:
    assert main(["--check"]) == 0


def test_a_stale_or_absent_file_is_told_in_one_sentence(
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


def test_every_topic_and_message_is_told() -> None:
    text = generate()
    for topic in TOPICS:
        assert f"`{topic.key}`" in text
        assert f"### {topic.message.__name__}\n" in text
        for field in topic.message.__struct_fields__:
            assert f"| `{field}` |" in text


def test_a_field_without_a_comment_is_refused() -> None:
    with pytest.raises(DocsError, match=r"A\.b: expected a comment with unit and frame, got none"):
        list(read_records("class A:\n    a: int  # fine\n\n    b: int\n", {}))


def test_an_array_without_a_shape_is_refused() -> None:
    with pytest.raises(DocsError, match=r"A\.a: expected a shape such as 17x3"):
        list(read_records("class A:\n    a: F32  # [m] where it is\n", {}))


def test_a_type_the_wire_does_not_know_is_refused() -> None:
    with pytest.raises(DocsError, match="complex"):
        list(read_records("class A:\n    a: list[complex]  # numbers\n", {}))


def test_types_in_words() -> None:
    source = '''
State = Literal["on", "off"]
class A:
    """Summary.

    More.
    """

    a: F32 | None = None  # [px] 17x3: u, v
    b: tuple[B, ...] = ()  # parts
    c: State = "on"  # what it does
    d: dict[str, float] = field(default_factory=dict)  # by name
    # [m] NxD of a line that is too long
    e: U16
    VERSION: ClassVar[int] = 1
'''
    (record,) = read_records(source, {})
    assert (record.name, record.summary) == ("A", "Summary.")
    assert [(field.name, field.kind, field.presence) for field in record.fields] == [
        ("a", "array float32 17x3 or nil", "nil"),
        ("b", "list of [B](#b)", "empty"),
        ("c", "text: on, off", "on"),
        ("d", "map of text to float", "empty"),
        ("e", "array uint16 NxD", "required"),
    ]
