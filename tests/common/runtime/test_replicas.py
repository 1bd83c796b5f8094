"""Two loops that share work on a real bus."""

import contextlib
import threading
from collections import Counter
from collections.abc import Iterator
from typing import ClassVar

import pytest

from common.runtime.loop import Loop
from common.runtime.node import Sharing
from common.transport.trace import ProcessId
from people4d.messages import Detections, Health, Message, Tracks
from tests.common.nodes import Echo, detections
from tests.network import WAIT_S, Network, Watcher

pytestmark = pytest.mark.network


class Shared(Echo):
    """Answers Detections with Tracks, in turns with its replicas."""

    sharing: ClassVar[Sharing] = Sharing(Detections, Tracks)


class Group:
    """Loops of one service, and a session that sends them work and receives the answers."""

    def __init__(self, network: Network) -> None:
        self._network, self._robot = network, network.robot()
        self._outside = network.open(self._robot, "peer")  # a router may drop messages under load
        self.watcher = Watcher(self._outside, Tracks, Health)
        self._running: list[tuple[Loop, threading.Thread]] = []
        self._sent = 0

    def add(self, name: str, node: Echo) -> None:
        process_id = ProcessId("echo", name, "host")
        loop = Loop(node, self._network.open(self._robot, "peer"), process_id)
        thread = threading.Thread(target=loop.run)
        thread.start()
        self._running.append((loop, thread))
        self.watcher.wait(Health, lambda h: h.instance == name)

    def send(self, count: int, camera: str = "front") -> range:
        numbers = range(self._sent, self._sent + count)
        for number in numbers:
            self._outside.publish(detections(number, camera))
        self._sent += count
        return numbers

    def answers(self, count: int) -> list[tuple[str, int]]:
        answers = (self.watcher.wait(Tracks) for _ in range(count))
        return [(t.trace[-1].process.partition("@")[0], t.sequence) for t in answers]

    def close(self) -> None:
        for loop, thread in self._running:
            loop.stop()
            thread.join(WAIT_S)
            assert not thread.is_alive()


@pytest.fixture
def group(network: Network) -> Iterator[Group]:
    with contextlib.closing(Group(network)) as made:
        yield made


def test_work_is_divided_alike_between_replicas(group: Group) -> None:
    group.add("a", Shared())
    group.add("b", Shared())
    sent = group.send(30)
    answers = group.answers(30)
    assert sorted(number for _, number in answers) == list(sent)
    assert Counter(name for name, _ in answers) == {"a": 15, "b": 15}


def test_replica_that_is_stuck_leaves_its_work_to_the_others(
    group: Group, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("common.runtime.replicas.STUCK_S", 0.2)
    stuck, let_go = threading.Event(), threading.Event()

    def hook(_: Message) -> None:
        stuck.set()
        assert let_go.wait(WAIT_S)

    group.add("a", Shared(hook))
    group.add("b", Shared())
    # Replica a is stuck with one of two messages; b handles that message, too, and all later ones.
    sent = group.send(2)
    answers = group.answers(2)
    assert stuck.is_set()
    assert sorted(answers) == [("b", number) for number in sent]
    group.send(10)
    assert {name for name, _ in group.answers(10)} == {"b"}
    # When a continues, its message is answered twice, and a gets its share again.
    let_go.set()
    ((name, number),) = group.answers(1)
    assert name == "a"
    assert number in sent
    while group.answers(len(group.send(1)))[0][0] != "a":
        pass


def test_frames_of_each_camera_are_divided_alike(group: Group) -> None:
    group.add("a", Shared())
    group.add("b", Shared())
    for camera in ("front", "rear"):
        group.send(10, camera)
        answers = group.answers(10)
        assert Counter(name for name, _ in answers) == {"a": 5, "b": 5}
