"""A source that stalls while its stamps do not: predictions meanwhile must not age any state."""

from collections.abc import Sequence

import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL, transform_from
from common.ros2.messages.person import RosPeopleView
from common.runtime.node import Node
from common.transport.memory_bus import MemoryBus
from deploy.viewers.scene import PeopleScene
from people4d.messages import Detection, Event, Message, Predictions, Tracks
from services.events.build import build as build_events
from services.events.config import EventsConfig
from services.predictor.build import build as build_predictor
from services.predictor.config import PredictorConfig
from services.tracker.build import build as build_tracker
from tests import builders
from tests.tracker.scene import published_config

MS = 1_000_000
FRAME_MS = 100
START_NS = 5_000 * MS
POSE = transform_from([0.0, 0.0, 1.0], LINK_FROM_OPTICAL[:3, :3])


def person(x_m: float) -> Detection:
    left_px = 320 + 200 * x_m
    return builders.detection(
        box_xyxy_px=np.array([left_px, 100, left_px + 100, 400], np.float32),
        score=0.9,
        position_m=np.array([x_m, 0.0, 3.0]),
    )


def play(stall_ms: int, rounds: int = 4) -> tuple[Sequence[Node], list[Message]]:
    """Let two people walk for `rounds` of 2 s, with a stall after each that stamps do not show."""
    nodes = (
        build_tracker(published_config(tracker="sort3d")),
        build_events(EventsConfig()),
        build_predictor(PredictorConfig()),
    )
    bus = MemoryBus(nodes)
    bus.publish(builders.static_transform(POSE))
    for number in range(20 * rounds):
        x_m = 0.01 * number
        frame = builders.detections(
            *(person(x_m), person(x_m - 1.5)),
            stamp_ns=START_NS + number * FRAME_MS * MS,
            sequence=number,
        )
        bus.publish(frame)
        waits_ms = FRAME_MS + (stall_ms if number % 20 == 19 else 0)
        for _ in range(waits_ms // 50):
            bus.advance(50 * MS)
    return nodes, bus.log


@pytest.mark.parametrize("stall_ms", [300, 700, 2500, 30_000])
def test_stall_makes_no_events_and_no_identities(stall_ms: int) -> None:
    nodes, log = play(stall_ms)
    events = [one for one in log if isinstance(one, Event)]
    assert [(one.kind, one.id) for one in events] == [("appeared", 1), ("appeared", 2)]
    assert any(one.predicted for one in log if isinstance(one, Tracks))
    for node in nodes:
        counters = node.status().counters
        assert counters.get("clock_resets", 0) == counters.get("stale", 0) == 0


def test_every_frame_is_predicted_after_a_stall_as_without() -> None:
    def stamps(stall_ms: int) -> list[int]:
        _, log = play(stall_ms)
        return [one.stamp_ns for one in log if isinstance(one, Predictions) and one.people]

    assert stamps(2500) == stamps(0)


def test_stall_ends_predictions_with_an_empty_message() -> None:
    _, log = play(2500, rounds=1)
    assert [one for one in log if isinstance(one, Predictions)][-1].people == ()


def test_stall_changes_neither_trajectories_nor_ages() -> None:
    def last(stall_ms: int) -> tuple[int, list[float]]:
        _, log = play(stall_ms)
        scene, view = PeopleScene(), RosPeopleView()
        for message in log:
            if isinstance(message, Tracks):
                shown, people = scene.add_message(message), view.tracks(message, {})
                if not message.predicted and shown:
                    found = len(shown.trajectories.get(1, ())), [one.age_s for one in people.people]
        return found

    assert last(2500) == last(0)
