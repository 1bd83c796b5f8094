"""Replicas as real processes: stopped, killed, added and ended while messages arrive."""

import os
import signal
import subprocess
import time
from collections import Counter
from collections.abc import Iterator, Sequence

import msgspec
import pytest

from people4d.codec import encode
from people4d.messages import Embeddings, Health, Tracks
from tests.contract.examples import BY_NAME
from tests.integration.processes import StoredCamera, start, threads, wait_ready
from tests.network import Network, Watcher

pytestmark = [pytest.mark.processes, pytest.mark.network]

# A replica that fails is replaced within 1.5 s; on a busy machine it may take this much longer.
REPLACED_S = 4.0
FRAMES = 12  # of StoredCamera


class Reids:
    """Replicas of re-identification, a publisher of crops and a subscriber to embeddings."""

    def __init__(self, network: Network) -> None:
        self._robot = network.robot()
        self._network = network
        self._bus = network.open(self._robot, "peer")  # a router may drop messages under load
        self._watcher = Watcher(self._bus, Embeddings, Health)
        self._sent = 0
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self.answers: Counter[int] = Counter()

    def start(self, name: str) -> None:
        self.processes[name] = start(self._network, self._robot, name)

    def wait_ready(self, name: str) -> None:
        wait_ready(self._watcher, {name})

    def ask(self) -> tuple[str, float]:
        """Send the crops of one frame; return the first replica that answers, and its delay [s]."""
        number, start_s = self._sent, time.monotonic()
        crops = BY_NAME["Crops"]
        self._bus.publish(msgspec.structs.replace(crops, sequence=number, stamp_ns=number))
        self._sent += 1
        return self._answer(number), time.monotonic() - start_s

    def ask_until(self, name: str) -> None:
        """Send crops until the named replica answers."""
        end_s = time.monotonic() + REPLACED_S
        while self.ask()[0] != name:
            assert time.monotonic() < end_s, f"{name} takes no share"

    def _answer(self, number: int) -> str:
        while True:
            embeddings = self._watcher.wait(Embeddings)
            self.answers[embeddings.sequence] += 1
            if embeddings.sequence == number:
                return embeddings.trace[-1].process.partition("@")[0]

    def close(self) -> None:
        for process in self.processes.values():
            process.kill()
            process.wait()


@pytest.fixture
def reids(network: Network) -> Iterator[Reids]:
    started = Reids(network)
    try:
        yield started
    finally:
        started.close()


def test_work_is_divided_among_replicas_and_taken_over_on_failure(reids: Reids) -> None:
    for name in ("reid-1", "reid-2"):
        reids.start(name)
    for name in ("reid-1", "reid-2"):
        reids.wait_ready(name)
    reids.ask_until("reid-1")
    reids.ask_until("reid-2")
    reids.answers.clear()
    by = Counter(reids.ask()[0] for _ in range(20))
    assert by == {"reid-1": 10, "reid-2": 10}
    assert set(reids.answers.values()) == {1}  # no duplicate replies

    # One replica hangs: the other takes over its work after 1.2 s without a heartbeat.
    os.kill(reids.processes["reid-2"].pid, signal.SIGSTOP)
    answers = [reids.ask() for _ in range(10)]
    assert {name for name, _ in answers} == {"reid-1"}
    waits_s = sorted(wait_s for _, wait_s in answers)
    assert waits_s[-1] < REPLACED_S
    assert waits_s[-2] < 0.5  # only once
    os.kill(reids.processes["reid-2"].pid, signal.SIGCONT)
    reids.ask_until("reid-2")

    # One is killed: its token vanishes with it.
    reids.processes["reid-2"].kill()
    answers = [reids.ask() for _ in range(10)]
    assert {name for name, _ in answers[1:]} == {"reid-1"}
    assert max(wait_s for _, wait_s in answers) < REPLACED_S

    # One joins and leaves again.
    reids.start("reid-3")
    reids.wait_ready("reid-3")
    reids.ask_until("reid-3")
    reids.answers.clear()
    reids.processes["reid-3"].send_signal(signal.SIGTERM)
    for _ in range(50):
        assert reids.ask()[1] < REPLACED_S
    assert reids.processes["reid-3"].wait(10) == 0
    assert reids.ask()[0] == "reid-1"
    assert (
        sum(reids.answers.values()) - len(reids.answers) <= 1
    )  # at most one duplicate, at the change


def test_two_detectors_give_the_same_tracks_as_one(network: Network) -> None:
    one, two = (tracks_of(network, count) for count in (1, 2))
    assert list(map(encode, one)) == list(map(encode, two))


def tracks_of(network: Network, detectors: int) -> list[Tracks]:
    """Return the tracks of every frame in lock-step, without their traces."""
    robot = network.robot()
    services: dict[str, Sequence[str]] = {
        "tracker-1": ("embedding_wait_s=60.0", "reorder_wait_s=60.0"),  # no frame is skipped
        "reid-1": (),
        **{f"detector-{k + 1}": () for k in range(detectors)},
        "camera-1": (
            f"source={StoredCamera.__module__}:{StoredCamera.__name__}",
            *("playback=lockstep", "window=4", "answer_timeout_s=60.0"),
        ),
    }
    watcher = Watcher(network.open(robot, "peer"), Tracks)  # a router may drop messages under load
    found = dict[int, Tracks]()  # a prediction has the number of the last frame
    with threads(network, robot, services):
        while len(found) < FRAMES:
            tracks = watcher.wait(Tracks)
            found.setdefault(tracks.sequence, msgspec.structs.replace(tracks, trace=()))
    return list(found.values())
