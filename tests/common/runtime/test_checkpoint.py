"""What a node keeps in files, and goes on from."""

import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from common.runtime.checkpoint import Keeper, KeptNode, keep
from people4d.errors import DecodeError
from people4d.messages import Message
from tests.common.nodes import Echo, detections

MS = 1_000_000


class Numbering(Echo):
    """Numbers what it handles, and knows its last number."""

    def __init__(self) -> None:
        super().__init__()
        self.next = 1
        self.known = b""

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        self.known = b"knows %d" % self.next
        self.next += 1
        return super().handle(message, now_ns)

    def next_number(self) -> int:
        return self.next

    def save(self) -> bytes:
        return self.known

    def restore(self, saved: bytes, next_number: int) -> None:
        self.next = max(self.next, next_number)
        if saved == b"damaged":
            raise DecodeError("this is damaged")
        self.known = saved


def started(folder: Path) -> tuple[Numbering, KeptNode]:
    node = Numbering()
    kept = keep(node, "tracker-1", {"PEOPLE4D_KEEP": str(folder)})
    assert isinstance(kept, KeptNode)
    return node, kept


def test_without_a_folder_or_a_lasting_node_nothing_is_kept(tmp_path: Path) -> None:
    lasting, other = Numbering(), Echo()
    assert keep(lasting, "tracker-1", {}) is lasting
    assert keep(other, "tracker-1", {"PEOPLE4D_KEEP": str(tmp_path)}) is other
    assert list(tmp_path.iterdir()) == []


def test_a_number_is_kept_before_it_is_told(tmp_path: Path) -> None:
    # Nothing is closed: the first process was killed right after handle returned.
    _, kept = started(tmp_path / "made")
    kept.handle(detections(0), 0)
    again, _ = started(tmp_path / "made")
    assert again.next == 2
    assert again.known == b""


def test_the_state_is_kept_four_times_a_second_while_something_comes(tmp_path: Path) -> None:
    _, kept = started(tmp_path)
    kept.handle(detections(0), 0)
    kept.tick(0)
    assert started(tmp_path)[0].known == b"knows 1"
    kept.handle(detections(1), 100 * MS)
    kept.tick(100 * MS)
    assert started(tmp_path)[0].known == b"knows 1"
    kept.tick(250 * MS)
    assert started(tmp_path)[0].known == b"knows 2"


def test_it_is_kept_though_something_is_always_due(tmp_path: Path) -> None:
    node, kept = started(tmp_path)
    for number, now_ns in enumerate(range(0, 600 * MS, 50 * MS)):
        kept.handle(detections(number), now_ns)
        node.due = [detections(0)]
        kept.tick(now_ns)
    # First at 0 + 250 ms, when the sixth was handled, then 500 ms later.
    assert started(tmp_path)[0].known == b"knows 6"


def test_it_is_kept_at_the_end(tmp_path: Path) -> None:
    node, kept = started(tmp_path)
    kept.handle(detections(0), 0)
    kept.close()
    assert node.closed
    assert started(tmp_path)[0].known == b"knows 1"


def test_everything_else_is_the_node_s_own(tmp_path: Path) -> None:
    node, kept = started(tmp_path)
    (answer,) = kept.handle(detections(5), 0)
    assert (answer.sequence, node.handled, kept.inputs) == (5, [5], Echo.inputs)
    assert kept.status() == node.status()
    assert not hasattr(kept, "set_wake")


def test_processes_of_other_names_keep_their_own(tmp_path: Path) -> None:
    started(tmp_path)[1].handle(detections(0), 0)
    other = Numbering()
    keep(other, "tracker-2", {"PEOPLE4D_KEEP": str(tmp_path)})
    assert other.next == 1


@pytest.mark.parametrize("bad", [b"", b"none", b"9" * 30])
def test_where_the_number_is_lost_no_one_has_had_the_next(tmp_path: Path, bad: bytes) -> None:
    before_s = int(time.time())
    started(tmp_path)[1].close()
    (tmp_path / "tracker-1.next.kept").write_bytes(bad)
    assert started(tmp_path)[0].next >= before_s


def test_where_only_the_state_is_left_no_one_has_had_the_next(tmp_path: Path) -> None:
    before_s = int(time.time())
    _, kept = started(tmp_path)
    kept.handle(detections(0), 0)
    kept.close()
    (tmp_path / "tracker-1.next.kept").unlink()
    node, _ = started(tmp_path)
    assert node.next >= before_s
    assert node.known == b"knows 1"


def test_a_damaged_state_costs_what_was_known_but_no_number(tmp_path: Path) -> None:
    _, kept = started(tmp_path)
    for number in range(3):
        kept.handle(detections(number), 0)
    kept.close()
    Keeper(tmp_path, "tracker-1").write_state(b"damaged")
    node, _ = started(tmp_path)
    assert (node.next, node.known) == (4, b"")


@pytest.mark.parametrize("cut", [0, 10, 21])
def test_a_process_killed_while_it_writes_leaves_the_state_before(tmp_path: Path, cut: int) -> None:
    keeper = Keeper(tmp_path, "tracker-1")
    keeper.write_number(7)
    for state in (b"first, which is long", b"second", b"third"):
        keeper.write_state(state)
    assert Keeper(tmp_path, "tracker-1").read().state == b"third"
    # The third one lies where the first did: only its beginning was written.
    file = tmp_path / "tracker-1.state1.kept"
    whole = file.read_bytes()
    file.write_bytes(whole[:cut] + b"\0" * (len(whole) - cut))
    again = Keeper(tmp_path, "tracker-1")
    assert again.read().state == b"second"
    again.write_state(b"fourth")
    assert Keeper(tmp_path, "tracker-1").read().state == b"fourth"


def test_a_folder_that_cannot_be_written_degrades_and_does_not_stop(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    node, kept = started(tmp_path / "file")
    assert kept.handle(detections(0), 0)
    kept.tick(0)
    status = kept.status()
    assert status.state == "degraded"
    assert status.reason.startswith(f"its state cannot be kept in {tmp_path / 'file'}")
    kept.close()
    assert node.closed
