"""Two areas of a site with a tracker each, as processes: one identity, one stream."""

import contextlib
import subprocess
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
import zenoh
from msgspec.structs import replace

from common.transport.zenoh_bus import read_config
from people4d.messages import AreaPeople, Health, Tracks
from tests import builders
from tests.integration.processes import start
from tests.network import Network, Watcher
from tests.tracker.test_node import MAP_FROM_CAMERA, detected, embeddings_of, person

pytestmark = [pytest.mark.processes, pytest.mark.network]

RED, BLUE = [1.0, 0.0], [0.0, 1.0]
PERIOD_S = 0.1


class AreaFeed:
    """Publishes detections of a camera ten times a second, of the people that are set."""

    def __init__(
        self, network: Network, name: str, camera: str = "front", y_m: float = 0.0
    ) -> None:
        self.people: Sequence[tuple[float, Sequence[float]]] = ()  # across [m], and appearance
        self._bus = network.open(name)
        self._camera = camera
        pose = MAP_FROM_CAMERA.copy()
        pose[1, 3] += y_m
        child = detected(0, camera=camera).frame_id
        self._transform = builders.static_transform(pose, child=child)
        self.watcher = Watcher(self._bus, Tracks, AreaPeople, Health)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        number = 0
        while not self._ended.wait(PERIOD_S):
            self._bus.publish(self._transform)
            frame = detected(number, [person(x) for x, _ in self.people], self._camera)
            frame = replace(frame, stamp_ns=time.time_ns())
            self._bus.publish(embeddings_of(frame, [appearance for _, appearance in self.people]))
            self._bus.publish(frame)
            number += 1

    def close(self) -> None:
        self._ended.set()
        self._thread.join()


def test_walker_has_one_identity_and_people_of_other_areas_outlive_a_tracker(
    network: Network, state_folder: Path
) -> None:
    hall, site = network.robot(), network.robot()
    a, b = f"{hall}_a", f"{hall}_b"
    with contextlib.ExitStack() as stack:

        def run(robot: str, instance: str, *settings: str) -> subprocess.Popen[bytes]:
            process = start(
                network, robot, instance, settings, PEOPLE4D_STATE=str(state_folder / robot)
            )
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        areas = ((a, 1, b), (b, 2, a))
        first, _ = (
            run(name, "tracker-1", f"area.number={n}", f'area.neighbours=["{other}"]')
            for name, n, other in areas
        )
        run(site, "site-1", f'areas=["{a}", "{b}"]')
        feeds = [AreaFeed(network, name) for name in (a, b)]
        for feed in feeds:
            stack.callback(feed.close)
        planner = Watcher(network.open(site), Tracks, Health)
        heard_keys = set[str]()
        keys = stack.enter_context(zenoh.open(read_config(None, "client", network.environment)))
        keys.declare_subscriber(
            f"people4d/v1/{hall}_$*/people", lambda sample: heard_keys.add(str(sample.key_expr))
        )

        # One person in each area: two identities in one stream.
        feeds[0].people, feeds[1].people = [(-1.0, RED)], [(1.4, BLUE)]
        both = planner.wait(Tracks, lambda m: {t.id % 1000 for t in m.tracks} == {1, 2})
        # One key expression matches all areas of a site, and no area of another site.
        assert heard_keys == {f"people4d/v1/{area}/people" for area in (a, b)}
        red, blue = (next(t.id for t in both.tracks if t.id % 1000 == n) for n in (1, 2))
        # Red leaves area a; area b receives the person and detects it 0.5 m farther.
        feeds[0].watcher.wait(AreaPeople, lambda m: red in {p.id for p in m.people})
        feeds[0].people = []
        heard = feeds[1].watcher.wait(Health, lambda h: h.service == "tracker")
        count = heard.counters.get("received_area_people", 0)
        feeds[1].watcher.wait(
            Health, lambda h: h.counters.get("received_area_people", 0) >= count + 10
        )
        feeds[1].people = [(1.4, BLUE), (-0.5, RED)]
        moved = feeds[1].watcher.wait(
            Tracks, lambda m: len([t for t in m.tracks if t.detection is not None]) == 2
        )
        assert {t.id for t in moved.tracks if t.detection is not None} == {red, blue}
        planner.wait(Tracks, lambda m: {t.id for t in m.tracks} == {red, blue})
        health = feeds[1].watcher.wait_for_counters(identities_taken_over=1)
        assert health.service == "tracker"

        # The tracker of area a dies: the tracks of area b continue.
        feeds[0].people = [(0.5, [0.6, 0.8])]
        planner.wait(Tracks, lambda m: {red, blue} < {t.id for t in m.tracks})
        first.kill()
        planner.wait(Tracks, lambda m: {t.id for t in m.tracks} == {red, blue})
        planner.wait(Health, lambda h: h.reason == f"no people arrive from {a}: they are left out")
        lonely = feeds[1].watcher.wait(Health, lambda h: "no messages arrive" in h.reason)
        assert (
            lonely.reason
            == f"no messages arrive from area {a}: people from there get new identities"
        )
        planner.wait(Tracks, lambda m: {t.id for t in m.tracks} == {red, blue})
