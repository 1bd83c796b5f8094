"""Packets to viewers, and the buffer that viewers go back in."""

import asyncio

import msgspec

from services.dashboard.history import History, Packet
from services.dashboard.hub import Demand, Hub, Viewer


def packet(at_ms: float, key: str = "scene front", kind: str = "scene", size: int = 1) -> Packet:
    return Packet(at_ms, key, ((kind, bytes(size)),))


async def taken(viewer: Viewer, count: int) -> list[Packet]:
    return [await asyncio.wait_for(viewer.next_packet(), 5) for _ in range(count)]


def test_history_is_bounded_in_time() -> None:
    history = History(60, 10**6)
    for second in range(200):
        history.add_packet(packet(second * 1000.0))
    assert history.begin_ms == 139_000


def test_history_is_bounded_in_bytes() -> None:
    history = History(60, 1000)
    for number in range(100):
        history.add_packet(packet(number * 100.0, size=100))
        assert history.size <= 1000
    assert history.begin_ms == 9000


def test_history_returns_the_newest_of_each_key_at_a_time() -> None:
    history = History(60, 10**6)
    history.add_packet(packet(1000, "scene front"))
    history.add_packet(packet(1100, "scene rear"))
    history.add_packet(packet(1200, "scene front"))
    assert [(one.key, one.at_ms) for one in history.packets_at(1150)] == [
        ("scene front", 1000),
        ("scene rear", 1100),
    ]
    assert [one.at_ms for one in history.packets_at(5000)] == []  # too long ago
    assert history.packets_at(999) == []


def frame_packet(at_ms: float, stamp_ns: int, *kinds: str) -> Packet:
    return Packet(at_ms, "scene front", tuple((kind, b"") for kind in kinds), stamp_ns)


def test_history_prefers_frames_with_all_parts_that_a_viewer_shows() -> None:
    history = History(60, 10**6)
    history.add_packet(frame_packet(1000, 1, "scene", "image", "cloud"))
    history.add_packet(frame_packet(1100, 2, "scene", "image"))
    history.add_packet(frame_packet(1200, 3, "scene"))
    for kinds, stamp_ns in (
        ({"scene", "image", "cloud"}, 1),
        ({"scene", "image"}, 2),
        ({"scene"}, 3),
    ):
        assert [one.stamp_ns for one in history.packets_at(1250, kinds)] == [stamp_ns]


def test_history_returns_skeletons_of_the_frame_alone() -> None:
    history = History(60, 10**6)
    history.add_packet(frame_packet(1000, 1, "scene"))
    history.add_packet(Packet(1050, "skeletons front", (("skeletons", b""),), 1))
    history.add_packet(frame_packet(1100, 2, "scene"))
    history.add_packet(frame_packet(1200, 3, "scene"))
    history.add_packet(Packet(1250, "skeletons front", (("skeletons", b""),), 3))
    assert [one.at_ms for one in history.packets_at(1210)] == [1200, 1250]
    assert [one.at_ms for one in history.packets_at(1150)] == [1100]  # its skeletons never arrived


def test_history_begins_anew_when_the_clock_is_set_back() -> None:
    history = History(60, 10**6)
    history.add_packet(packet(5000))
    history.add_packet(packet(1000))
    assert history.begin_ms == 1000
    assert history.size == 1


def test_slow_viewer_gets_the_newest_packet_of_each_key() -> None:
    async def run() -> list[float]:
        viewer = Viewer("operator")
        for number in range(1000):
            viewer.add_packet(packet(number))
        viewer.add_packet(packet(5, "health"))
        return [one.at_ms for one in await taken(viewer, 2)]

    assert asyncio.run(run()) == [999, 5]


def test_planner_gets_no_pixels() -> None:
    viewer = Viewer("planner", cloud=True)
    assert not viewer.wants("image")
    assert not viewer.wants("cloud")
    assert viewer.wants("scene")


def test_demand_follows_the_viewers() -> None:
    demands: list[Demand] = []
    hub = Hub(History(60, 10**6), demands.append)
    planner, operator = Viewer("planner"), Viewer("operator", cloud=True)
    hub.join(planner)
    hub.join(operator)
    operator.paused = True
    hub.update_demand()
    hub.leave(operator)
    hub.leave(planner)
    assert demands == [
        Demand(1, False, False),
        Demand(2, True, True),
        Demand(2, True, False),
        Demand(1, False, False),
        Demand(),
    ]


def test_paused_viewer_gets_health_and_what_it_seeks() -> None:
    async def run() -> list[tuple[str, float]]:
        hub = Hub(History(60, 10**6), lambda _: None)
        hub.attach(asyncio.get_running_loop())
        viewer = Viewer("operator")
        hub.join(viewer)
        await taken(viewer, 2)  # about, trajectories
        hub.publish(packet(1000))
        await taken(viewer, 1)
        viewer.paused = True
        hub.publish(packet(2000))
        hub.publish(packet(2000, "health", "health"))
        found = await taken(viewer, 1)
        hub.seek(viewer, 1500)
        found += await taken(viewer, 1)
        return [(one.key, one.at_ms) for one in found]

    assert asyncio.run(run()) == [("health", 2000), ("scene front", 1000)]


def test_page_that_opens_later_gets_what_stays() -> None:
    async def run() -> list[str]:
        hub = Hub(History(60, 10**6), lambda _: None)
        hub.attach(asyncio.get_running_loop())
        hub.publish(packet(1, "zones", "zones"), stays=True)
        await asyncio.sleep(0)
        viewer = Viewer("operator")
        hub.join(viewer)
        return [msgspec.msgpack.decode(p.parts[0][1])["type"] for p in await taken(viewer, 2)] + [
            one.key for one in await taken(viewer, 1)
        ]

    assert asyncio.run(run()) == ["about", "trajectories", "zones"]
