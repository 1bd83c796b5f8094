"""One tracker with cameras of three hosts, each with a router; one host fails."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from people4d.messages import Health, Tracks
from tests.integration.processes import start
from tests.integration.test_areas import AreaFeed
from tests.network import Network, Watcher

pytestmark = [pytest.mark.processes, pytest.mark.network]

HOSTS = ("cam1", "cam2", "cam3")


@pytest.fixture
def routers() -> Iterator[list[Network]]:
    with contextlib.ExitStack() as stack:
        made = [Network() for _ in HOSTS]
        for network in made:
            stack.callback(network.close)
        yield made


def test_cameras_of_other_hosts_outlive_one(routers: list[Network], state_folder: Path) -> None:
    with contextlib.ExitStack() as stack:
        feeds = []
        for n, (host, network) in enumerate(zip(HOSTS, routers, strict=True)):
            # Two cameras a host; their people stand 3 m from the people of the next host.
            cameras = (f"c{2 * n + 1}", f"c{2 * n + 2}")
            for camera in cameras:
                feeds.append(AreaFeed(network, host, camera, 3.0 * n))
                stack.callback(feeds[-1].close)
                # Each host has a person of its own appearance.
                feeds[-1].people = [(0.0, np.eye(len(HOSTS))[n].tolist())]
        endpoints = ",".join(network.endpoint for network in routers)
        listed = ", ".join(f'"{host}"' for host in HOSTS)
        tracker = start(
            routers[0],
            "hall",
            "tracker-1",
            [f"area.hosts=[{listed}]"],
            PEOPLE4D_STATE=str(state_folder),
            PEOPLE4D_CONNECT=endpoints,
            PEOPLE4D_MODE="area",
        )
        stack.callback(tracker.wait)
        stack.callback(tracker.kill)
        # A planner hears one stream through any of the routers.
        planner = Watcher(routers[1].open("hall"), Tracks, Health)
        cameras_heard = set[str]()

        def is_complete(message: Tracks) -> bool:
            cameras_heard.add(message.camera)
            measured = [t for t in message.tracks if t.state == "confirmed"]
            return len(message.tracks) == len(HOSTS) and bool(measured) and len(cameras_heard) == 6

        complete = planner.wait(Tracks, is_complete)
        people = {round(float(t.position_m[1]) / 3): t.id for t in complete.tracks}

        # The first host dies with its router: the people of the other hosts keep their identities.
        for feed in feeds[:2]:
            feed.close()
        routers[0].close()
        health = planner.wait(Health, lambda h: "no detections arrive from host cam1" in h.reason)
        assert health.state == "degraded"
        left = planner.wait(
            Tracks, lambda m: {t.id for t in m.tracks} == set(people.values()) - {people[0]}
        )
        assert all(t.id in people.values() for t in left.tracks)
