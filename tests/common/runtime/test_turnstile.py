"""Turnstile between two threads: a frame is not taken while a newer one may replace it."""

import threading
from collections.abc import Sequence

import msgspec
import pytest

from common.runtime.node import LoopCallbacks
from people4d.messages import Message, RgbdFrame, Truth
from tests import builders
from tests.common.nodes import Echo
from tests.common.runtime.test_loop import running
from tests.contract.examples import BY_NAME
from tests.network import WAIT_S, Network

pytestmark = pytest.mark.network


class Heavy(Echo):
    """Answers frames with Truth of the same number, in a heavy part and a light one."""

    inputs: tuple[type[Message], ...] = (RgbdFrame,)

    def __init__(self) -> None:
        super().__init__()
        self.begun, self.heavy_done, self.light_done = (threading.Event() for _ in range(3))

    def attach(self, loop: LoopCallbacks) -> None:
        self.loop = loop

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        self.handled.append(message.sequence)
        self.begun.set()
        assert self.heavy_done.wait(WAIT_S)
        self.loop.release()
        assert message.sequence > 1 or self.light_done.wait(WAIT_S)
        return [builders.truth(sequence=message.sequence)]


def frame(sequence: int, lockstep: bool) -> Message:
    return msgspec.structs.replace(BY_NAME["RgbdFrame"], sequence=sequence, lockstep=lockstep)


def test_frames_wait_in_the_inbox_while_the_heavy_part_runs(network: Network) -> None:
    node = Heavy()
    with running(network, node, workers=2) as run:
        run.send(frame(1, lockstep=False))
        assert node.begun.wait(WAIT_S)
        run.send(*(frame(k, lockstep=False) for k in (2, 3, 4)))
        run.watcher.wait_for_counters(received_frames=4, dropped_frames=2)
        assert node.handled == [1]
        # The second thread begins with the newest frame during the light part of the first.
        node.begun.clear()
        node.heavy_done.set()
        assert node.begun.wait(WAIT_S)
        assert node.handled == [1, 4]
        node.light_done.set()
        assert [run.watcher.wait(Truth).sequence for _ in range(2)] == [1, 4]


def test_frames_that_must_not_be_skipped_are_taken_at_once(network: Network) -> None:
    node = Heavy()
    with running(network, node, workers=2) as run:
        run.send(frame(1, lockstep=True))
        assert node.begun.wait(WAIT_S)
        node.begun.clear()
        run.send(frame(2, lockstep=True))
        assert node.begun.wait(WAIT_S)
        assert sorted(node.handled) == [1, 2]
        node.heavy_done.set()
        node.light_done.set()


class Early(Heavy):
    """Sends Tracks before it is done with the Truth."""

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        tracks = msgspec.structs.replace(BY_NAME["Tracks"], sequence=message.sequence, trace=())
        assert self.loop.publish
        self.loop.publish(tracks)
        assert self.heavy_done.wait(WAIT_S)
        return [builders.truth(sequence=message.sequence)]


def test_output_that_is_ready_first_is_published_first(network: Network) -> None:
    node = Early()
    with running(network, node, workers=2) as run:
        run.send(frame(1, lockstep=True), frame(2, lockstep=True))
        assert run.tracks(1) == [1]  # while the rest of the answer is still being made
        node.heavy_done.set()
        assert run.tracks(1) == [2]
        assert [run.watcher.wait(Truth).sequence for _ in range(2)] == [1, 2]
