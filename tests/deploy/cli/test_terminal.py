"""Text of others in the terminal."""

import io

import msgspec
import pytest
from rich.console import Console

from deploy.cli import print_error
from deploy.cli.live.views import table_of
from deploy.cli.terminal import plain_table, print_table, shown
from people4d.codec import decode, encode
from people4d.errors import DecodeError, People4dError
from tests import builders
from tests.contract.examples import BY_NAME

HOSTILE = "dir[/x] \x1b]0;title\x07\x1b[31m\nend"
PLAIN = "dir[/x]  ]0;title  [31m end"


def printed(text: str) -> str:
    console = Console(file=io.StringIO(), width=200, soft_wrap=True, highlight=False)
    table = plain_table("name")
    table.add_row(shown(text))
    console.print(shown(text))
    console.print(table)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_foreign_text_is_shown_as_it_is_without_commands() -> None:
    lines = printed(HOSTILE).splitlines()
    assert [line.rstrip() for line in lines] == [PLAIN, "name", PLAIN]


def test_a_table_wider_than_the_terminal_is_printed_entire(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    titles = [f"a long title, the {number}th" for number in range(6)]
    table = plain_table(*titles)
    table.add_row(*(f"{number:.3f}" for number in range(6)))
    print_table(table)
    head, row = capsys.readouterr().out.splitlines()
    assert all(title in head for title in titles)
    assert row.split() == ["0.000", "1.000", "2.000", "3.000", "4.000", "5.000"]


def test_an_error_that_quotes_a_hostile_name_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    print_error(People4dError(f"{HOSTILE!s} is no folder", "Give a folder."))
    text = capsys.readouterr().err
    assert "dir[/x]" in text
    assert "\x1b" not in text


def test_a_message_with_commands_for_the_terminal_is_refused() -> None:
    for name, field in (("Tracks", "tracker"), ("Detections", "model"), ("Embeddings", "model")):
        payload = encode(BY_NAME[name])
        fields = msgspec.msgpack.decode(payload) | {field: "\x1b[31m"}
        with pytest.raises(DecodeError, match=f"{field}: expected printable text"):
            decode(msgspec.msgpack.encode(fields))


def test_a_trace_with_commands_for_the_terminal_is_refused() -> None:
    fields = msgspec.msgpack.decode(encode(BY_NAME["Tracks"]))
    fields["trace"] = [{"stage": "\x1b[31m", "process": "a", "start_ns": 1, "end_ns": 2}]
    with pytest.raises(DecodeError, match="stage"):
        decode(msgspec.msgpack.encode(fields))


def test_brackets_in_the_name_of_a_tracker_do_not_end_listen() -> None:
    tracks = builders.tracks(tracks=(builders.track(),), tracker="[/bold]")
    console = Console(file=io.StringIO(), width=200)
    console.print(table_of(tracks, 0))
    assert isinstance(console.file, io.StringIO)
    assert "[/bold]" in console.file.getvalue()
