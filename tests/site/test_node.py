"""One stream of people of several areas."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from common.runtime.node import LoopCallbacks
from people4d.codec import encode
from people4d.errors import ConfigError, DecodeError
from people4d.messages import Track, Tracks
from services.site.build import build
from services.site.config import SiteConfig
from services.site.node import SiteNode
from tests import builders

S, MS = 1_000_000_000, 1_000_000


def site(*areas: str) -> SiteNode:
    node = build(SiteConfig(areas=areas))
    node.attach(LoopCallbacks(robot="site"))
    node.tick(1)
    return node


def walker(number: int, x: float = 0.0) -> Track:
    position_m, velocity_mps = np.array([x, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    return builders.track(id=number, position_m=position_m, velocity_mps=velocity_mps)


def hear(node: SiteNode, area: str, now_ns: int, *people: Track, **fields: Any) -> None:
    """Send people of an area to the site, encoded."""
    message = builders.tracks(*people, **{"stamp_ns": now_ns, **fields})
    topic = next(t for t in node.foreign_inputs if t.key == f"people4d/v1/{area}/people")
    node.handle(topic.decode(encode(message)), now_ns)


def say(node: SiteNode, now_ns: int) -> Sequence[Track]:
    (message,) = node.tick(now_ns)
    assert isinstance(message, Tracks)
    return message.tracks


def test_people_of_all_areas_come_in_one_message() -> None:
    node = site("a", "b")
    hear(node, "a", S, walker(1))
    hear(node, "b", S, walker(2, 5.0))
    # 0.2 s later at 1 m/s.
    found = say(node, S + 200 * MS)
    assert [(t.id, round(float(t.position_m[0]), 6)) for t in found] == [(1, 0.2), (2, 5.2)]


def test_message_has_the_stamp_of_the_frames_that_come_now() -> None:
    node = site("a")
    for k in range(5):
        hear(node, "a", S + k * 100 * MS, walker(1), stamp_ns=7 * S + k * 100 * MS)
    (message,) = node.tick(S + 450 * MS)
    assert message.stamp_ns == 7 * S + 450 * MS


def test_people_of_an_area_whose_tracker_ended_are_left_out() -> None:
    node = site("a", "b")
    hear(node, "a", S, walker(1))
    for k in range(60):
        hear(node, "b", S + k * 100 * MS, walker(2, 5.0))
    assert [t.id for t in say(node, 7 * S)] == [2]
    assert node.status().reason == "no people arrive from a: they are left out"


def test_person_of_one_camera_stays_while_others_send() -> None:
    node = site("a")
    hear(node, "a", S, walker(1), camera="c0")
    hear(node, "a", S + MS, walker(1), walker(2, 3.0), camera="c1")
    assert [t.id for t in say(node, S + 2 * MS)] == [1, 2]


def test_clock_of_an_area_that_is_apart_is_reported() -> None:
    node = site("a", "b")
    hear(node, "a", S, walker(1))
    hear(node, "b", S, walker(2, 5.0), stamp_ns=-4 * S)
    assert node.status().reason == "the clock of area b is 5.0 s behind the first"
    assert node.status().counters["clock_apart"] == 1
    assert len(say(node, S + MS)) == 2


def test_people_in_another_frame_are_left_out() -> None:
    node = site("a", "b")
    hear(node, "a", S, walker(1))
    hear(node, "b", S, walker(2), frame_id="odom")
    assert [t.id for t in say(node, S + MS)] == [1]
    assert node.status().counters["other_frame"] == 1
    assert node.status().reason == "people in frames other than map are left out"


def test_site_without_areas_says_so() -> None:
    node = site()
    assert not node.tick(S)
    assert node.status().reason == "no areas are configured: site.areas"


def test_impossible_configuration_is_refused() -> None:
    with pytest.raises(ConfigError, match="each name once"):
        build(SiteConfig(areas=("a", "a")))
    with pytest.raises(ConfigError, match="the site has the name of its area a"):
        build(SiteConfig(areas=("a",))).attach(LoopCallbacks(robot="a"))


def test_other_messages_are_refused() -> None:
    topic = site("a").foreign_inputs[0]
    with pytest.raises(DecodeError, match="expected Tracks, got Detections"):
        topic.decode(encode(builders.detections()))
