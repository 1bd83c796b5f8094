"""Two loops that share work on a real bus."""

import contextlib
import threading
from collections import Counter
from collections.abc import Iterator
from typing import ClassVar

import pytest

from common.runtime.loop import Loop
from common.runtime.node import Sharing
from common.runtime.process_id import Place
from people4d.messages import Detections, Health, Message, Tracks
from tests.common.nodes import Echo, detections
from tests.network import WAIT_S, Network, Watcher


class Shared(Echo):
    """Answers Detections with Tracks; its replicas do so by turns."""

    sharing: ClassVar[Sharing] = Sharing(Detections, Tracks)


class Team:
    """Loops of one service, somebody who sends them work, and who answers it."""

    def __init__(self, network: Network) -> None:
        self._network, self._robot = network, network.robot()
        self._outside = network.open(self._robot, "peer")  # a router may drop in a rush
        self.watcher = Watcher(self._outside, Tracks, Health)
        self._running: list[tuple[Loop, threading.Thread]] = []
        self._sent = 0

    def add(self, name: str, node: Echo, capacity: int = 1) -> None:
        place = Place("echo", name, "host", capacity)
        loop = Loop(node, self._network.open(self._robot, "peer"), place)
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
        told = (self.watcher.wait(Tracks) for _ in range(count))
        return [(t.trace[-1].process.partition("@")[0], t.sequence) for t in told]

    def close(self) -> None:
        for loop, thread in self._running:
            loop.stop()
            thread.join(WAIT_S)
            assert not thread.is_alive()


@pytest.fixture(scope="module")
def network() -> Iterator[Network]:
    network = Network()
    yield network
    network.close()


@pytest.fixture
def team(network: Network) -> Iterator[Team]:
    with contextlib.closing(Team(network)) as made:
        yield made


def test_work_is_divided_by_capacity(team: Team) -> None:
    team.add("a", Shared(), capacity=2)
    team.add("b", Shared())
    sent = team.send(30)
    answers = team.answers(30)
    assert sorted(number for _, number in answers) == list(sent)
    assert Counter(name for name, _ in answers) == {"a": 20, "b": 10}


def test_one_that_is_stuck_gives_its_turns_away(
    team: Team, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("common.runtime.replica.STUCK_S", 0.2)
    stuck, let_go = threading.Event(), threading.Event()

    def hook(_: Message) -> None:
        stuck.set()
        assert let_go.wait(WAIT_S)

    team.add("a", Shared(hook))
    team.add("b", Shared())
    # One of two is a's, which is stuck with it; b does that one, too, and all that follow.
    sent = team.send(2)
    answers = team.answers(2)
    assert stuck.is_set()
    assert sorted(answers) == [("b", number) for number in sent]
    team.send(10)
    assert {name for name, _ in team.answers(10)} == {"b"}
    # When it goes on, what it was stuck with is answered twice, and it gets its turns back.
    let_go.set()
    ((name, number),) = team.answers(1)
    assert name == "a"
    assert number in sent
    while team.answers(len(team.send(1)))[0][0] != "a":
        pass


def test_cameras_are_shared_alike(team: Team) -> None:
    team.add("a", Shared())
    team.add("b", Shared())
    for camera in ("front", "rear"):
        team.send(10, camera)
        answers = team.answers(10)
        assert Counter(name for name, _ in answers) == {"a": 5, "b": 5}
