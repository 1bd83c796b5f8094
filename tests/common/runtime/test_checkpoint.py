"""Checkpoints of a node and its restart from them."""

import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from common.runtime.checkpoint import Checkpoint, CheckpointStore
from common.runtime.heartbeat import Activity
from common.runtime.node import StatefulNode
from people4d.errors import DecodeError
from people4d.messages import Message
from tests.common.nodes import Echo, detections

MS = 1_000_000


class Numbering(Echo, StatefulNode):
    """Numbers the messages that it handles; its state is the last number."""

    def __init__(self) -> None:
        super().__init__()
        self.next = 1
        self.saved = b""

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        self.saved = b"last %d" % self.next
        self.next += 1
        return super().handle(message, now_ns)

    def next_number(self) -> int:
        return self.next

    def save(self) -> bytes:
        return self.saved

    def restore(self, saved: bytes, next_number: int) -> None:
        self.next = max(self.next, next_number)
        if saved == b"damaged":
            raise DecodeError("this is damaged")
        if saved == b"odd":
            raise IndexError("this is damaged, but no check finds it")
        self.saved = saved


class Process:
    """A process that runs a node like the loop of a service."""

    def __init__(self, folder: Path, instance: str = "tracker-1") -> None:
        self.node, self.activity = Numbering(), Activity()
        self.checkpoint = Checkpoint(self.node, CheckpointStore(folder, instance), self.activity)

    def handle(self, sequence: int) -> None:
        self.node.handle(detections(sequence), 0)
        self.checkpoint.handled()


def test_number_is_saved_as_soon_as_a_message_is_handled(tmp_path: Path) -> None:
    # No cleanup runs: the first process is killed right after handle returned.
    Process(tmp_path / "made").handle(0)
    again = Process(tmp_path / "made").node
    assert (again.next, again.saved) == (2, b"")


def test_state_is_saved_four_times_a_second_while_messages_arrive(tmp_path: Path) -> None:
    process = Process(tmp_path)
    process.handle(0)
    process.checkpoint.ticked(0, has_outputs=False)
    assert Process(tmp_path).node.saved == b"last 1"
    process.handle(1)
    process.checkpoint.ticked(100 * MS, has_outputs=False)
    assert Process(tmp_path).node.saved == b"last 1"
    process.checkpoint.ticked(250 * MS, has_outputs=False)
    assert Process(tmp_path).node.saved == b"last 2"


def test_state_is_saved_though_outputs_are_always_due(tmp_path: Path) -> None:
    process = Process(tmp_path)
    for number, now_ns in enumerate(range(0, 600 * MS, 50 * MS)):
        process.handle(number)
        process.checkpoint.ticked(now_ns, has_outputs=True)
    # First at 0 + 250 ms, when the sixth was handled, then 500 ms later.
    assert Process(tmp_path).node.saved == b"last 6"


def test_processes_of_other_names_have_states_of_their_own(tmp_path: Path) -> None:
    Process(tmp_path).handle(0)
    assert Process(tmp_path, "tracker-2").node.next == 1


@pytest.mark.parametrize("bad", [b"", b"none", b"9" * 30])
def test_lost_number_is_replaced_by_one_that_was_never_given(tmp_path: Path, bad: bytes) -> None:
    before_s = int(time.time())
    Process(tmp_path).checkpoint.save_state()
    (tmp_path / "tracker-1.next.checkpoint").write_bytes(bad)
    assert Process(tmp_path).node.next >= before_s


def test_state_without_its_number_is_restored_with_a_new_number(tmp_path: Path) -> None:
    before_s = int(time.time())
    process = Process(tmp_path)
    process.handle(0)
    process.checkpoint.save_state()
    (tmp_path / "tracker-1.next.checkpoint").unlink()
    node = Process(tmp_path).node
    assert node.next >= before_s
    assert node.saved == b"last 1"


@pytest.mark.parametrize("state", [b"damaged", b"odd"])
def test_damaged_state_is_lost_but_not_its_number(tmp_path: Path, state: bytes) -> None:
    process = Process(tmp_path)
    for number in range(3):
        process.handle(number)
    process.checkpoint.save_state()
    CheckpointStore(tmp_path, "tracker-1").write_state(state)
    node = Process(tmp_path).node
    assert (node.next, node.saved) == (4, b"")


@pytest.mark.parametrize("cut", [0, 10, 21])
def test_process_killed_while_it_writes_leaves_the_earlier_state(tmp_path: Path, cut: int) -> None:
    store = CheckpointStore(tmp_path, "tracker-1")
    store.write_number(7)
    for state in (b"first, which is long", b"second", b"third"):
        store.write_state(state)
    assert CheckpointStore(tmp_path, "tracker-1").read().state == b"third"
    # The third checkpoint replaces the first; only its beginning was written.
    file = tmp_path / "tracker-1.state1.checkpoint"
    content = file.read_bytes()
    file.write_bytes(content[:cut] + b"\0" * (len(content) - cut))
    again = CheckpointStore(tmp_path, "tracker-1")
    assert again.read().state == b"second"
    again.write_state(b"fourth")
    assert CheckpointStore(tmp_path, "tracker-1").read().state == b"fourth"


def test_folder_that_cannot_be_written_is_a_problem_of_the_process(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    process = Process(tmp_path / "file")
    assert process.activity.problem.startswith(f"its state cannot be saved in {tmp_path / 'file'}")
    process.handle(0)
    process.checkpoint.save_state()


def test_state_that_finds_no_room_stays_a_problem_though_its_number_does(tmp_path: Path) -> None:
    process = Process(tmp_path)
    for index in (0, 1):
        (tmp_path / f"tracker-1.state{index}.checkpoint").mkdir()
    process.handle(0)
    process.checkpoint.save_state()
    assert process.activity.problem.startswith(f"its state cannot be saved in {tmp_path}")
    process.handle(1)
    assert (tmp_path / "tracker-1.next.checkpoint").read_bytes() != b""
    assert process.activity.problem.startswith(f"its state cannot be saved in {tmp_path}")
