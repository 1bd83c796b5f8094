"""A tracker process that is killed or hangs, and what its successor knows."""

import contextlib
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

from people4d.messages import Health, Message, Tracks
from tests.integration.processes import start
from tests.network import Network, Watcher
from tests.tracker.test_node import TRANSFORM, looks, person, seen

TWO = ([1.0, 0.0], [0.0, 1.0])


class Feeding:
    """Somebody who sends frames and hears people; a tracker process can be started beside."""

    def __init__(self, network: Network, folder: Path) -> None:
        self.robot = network.robot()
        self.bus = network.open(self.robot)
        self.watcher = Watcher(self.bus, Tracks, Health)
        self._network, self._folder = network, str(folder)

    @contextlib.contextmanager
    def tracker(self) -> Iterator[subprocess.Popen[bytes]]:
        """Run a tracker; the block begins when it listens, and ends with its death."""
        settings = ("embedding_wait_s=1.0",)
        with start(
            self._network, self.robot, "tracker-1", settings, PEOPLE4D_STATE=self._folder
        ) as process:
            try:
                self.watcher.wait(Health, lambda h: h.pid == process.pid)
                yield process
            finally:
                process.kill()

    def see(self, numbers: range, shift_m: float = 0.0) -> Tracks:
        """Send frames of two people, ten a second by their stamps; return the last answer."""
        self.bus.publish(TRANSFORM)
        for k in numbers:
            frame = seen(k, [person(-0.8 + shift_m), person(0.8 + shift_m)])
            self.bus.publish(looks(frame, TWO))
            self.bus.publish(frame)
        return self.watcher.wait(Tracks, is_number(numbers[-1]))


def is_number(number: int) -> Callable[[Message], bool]:
    return lambda message: message.sequence == number


def test_a_killed_tracker_knows_its_people_again_and_gives_no_identity_twice(
    network: Network, tmp_path: Path
) -> None:
    feeding = Feeding(network, tmp_path)
    with feeding.tracker() as first:
        assert [p.id for p in feeding.see(range(20)).tracks] == [1, 2]
        for _ in range(3):  # what it knows is kept within half a second: two heartbeats
            feeding.watcher.wait(Health)
        first.send_signal(signal.SIGKILL)
    with feeding.tracker():  # 1.5 s and 0.3 m later
        told = feeding.see(range(35, 45), shift_m=0.3)
        assert [(p.id, p.state) for p in told.tracks] == [(1, "confirmed"), (2, "confirmed")]
        # Ten seconds later, elsewhere, it is others.
        others = feeding.see(range(150, 160), shift_m=3.0).tracks
        assert [p.id for p in others if p.state == "confirmed"] == [3, 4]


def test_what_a_stopped_tracker_has_received_is_answered(network: Network, tmp_path: Path) -> None:
    feeding = Feeding(network, tmp_path)
    with feeding.tracker() as tracker:
        feeding.see(range(5))
        for k in range(5, 45):  # their embeddings do not come, so all of them wait
            feeding.bus.publish(seen(k, [person()]))
        tracker.send_signal(signal.SIGTERM)
        counters = feeding.watcher.wait(Health, lambda h: h.state == "stopping").counters
        assert tracker.wait(10) == 0
    assert counters["received_detections"] > 5
    assert counters["sent_people"] == counters["received_detections"]
    feeding.watcher.wait(Tracks, is_number(counters["sent_people"] - 1))
