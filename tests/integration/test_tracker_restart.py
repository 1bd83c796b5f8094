"""Identities after a tracker process is killed, and its answers after it is stopped."""

import contextlib
import signal
import subprocess
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from people4d.messages import Health, Message, Tracks
from tests.integration.processes import start
from tests.network import Network, Watcher
from tests.tracker.test_node import TRANSFORM, detected, embeddings_of, person

pytestmark = [pytest.mark.processes, pytest.mark.network]

TWO = ([1.0, 0.0], [0.0, 1.0])
OTHERS = ([-1.0, 0.0], [0.0, -1.0])


class Feeding:
    """A publisher of detections and a subscriber to tracks, for a tracker process."""

    def __init__(self, network: Network, folder: Path) -> None:
        self.robot = network.robot()
        self.bus = network.open(self.robot)
        self.watcher = Watcher(self.bus, Tracks, Health)
        self._network, self._folder = network, str(folder)

    @contextlib.contextmanager
    def tracker(self) -> Iterator[subprocess.Popen[bytes]]:
        """Run a tracker; the block begins once it has the transform and ends by killing it.

        Topics have no common order: a transform that arrives after frames deletes their tracks.
        """
        settings = ("embedding_wait_s=1.0",)
        with start(
            self._network, self.robot, "tracker-1", settings, PEOPLE4D_STATE=self._folder
        ) as process:
            try:
                self.watcher.wait(Health, lambda h: h.pid == process.pid)
                self.bus.publish(TRANSFORM)
                self.watcher.wait_for_counters(received_static_transforms=1)
                yield process
            finally:
                process.kill()

    def see(
        self, numbers: range, shift_m: float = 0.0, embeddings: Sequence[Sequence[float]] = TWO
    ) -> Tracks:
        """Send frames of two people, ten a second by their stamps; return the last answer."""
        for k in numbers:
            frame = detected(k, [person(-0.8 + shift_m), person(0.8 + shift_m)])
            self.bus.publish(embeddings_of(frame, embeddings))
            self.bus.publish(frame)
        return self.watcher.wait(Tracks, is_number(numbers[-1]))


def is_number(number: int) -> Callable[[Message], bool]:
    return lambda message: message.sequence == number


def test_killed_tracker_restores_identities_and_reuses_none(
    network: Network, tmp_path: Path
) -> None:
    feeding = Feeding(network, tmp_path)
    with feeding.tracker() as first:
        before = sorted(track.id for track in feeding.see(range(20)).tracks)
        assert len(before) == 2
        for _ in range(3):  # a checkpoint is written within two heartbeats
            feeding.watcher.wait(Health)
        first.send_signal(signal.SIGKILL)
    with feeding.tracker():  # 1.5 s and 0.3 m later
        tracks = sorted(feeding.see(range(35, 45), shift_m=0.3).tracks, key=lambda t: t.id)
        assert [(t.id, t.state) for t in tracks] == [(k, "confirmed") for k in before]
        # Ten seconds later two people of another appearance arrive, 2.7 m away.
        others = feeding.see(range(150, 160), shift_m=3.0, embeddings=OTHERS).tracks
        confirmed = [track.id for track in others if track.state == "confirmed"]
        assert len(confirmed) == 2
        assert min(confirmed) > max(before)


def test_stopped_tracker_answers_all_received_detections(network: Network, tmp_path: Path) -> None:
    feeding = Feeding(network, tmp_path)
    with feeding.tracker() as tracker:
        feeding.see(range(5))
        for k in range(5, 45):  # their embeddings do not arrive, so all of them wait
            feeding.bus.publish(detected(k, [person()]))
        feeding.watcher.wait_for_counters(received_detections=6)
        tracker.send_signal(signal.SIGTERM)
        counters = feeding.watcher.wait(Health, lambda h: h.state == "stopping").counters
        assert tracker.wait(10) == 0
    assert counters["received_detections"] > 5
    # On a busy machine predictions are also sent, with the number of the previous frame.
    assert counters["sent_people"] >= counters["received_detections"]
    feeding.watcher.wait(Tracks, is_number(counters["received_detections"] - 1))
