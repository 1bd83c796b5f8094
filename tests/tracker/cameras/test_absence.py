"""Cameras that send nothing, or detect no people in their view."""

import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL, transform_from
from people4d.messages import Track
from services.tracker.cameras.absence import CameraAbsence
from services.tracker.interface import ImageEdges, Measurement, Observation
from tests import builders

S, MS = 1_000_000_000, 1_000_000
POSE = transform_from([0.0, 0.0, 1.0], LINK_FROM_OPTICAL[:3, :3])  # looks along x of the map


def track(x: float = 3.0, y: float = 0.0) -> Track:
    return builders.track(position_m=np.array([x, y, 1.0]))


def observation(camera: str, time_ns: int, found: int) -> Observation:
    box = np.array([100.0, 100.0, 200.0, 300.0])
    people = tuple(
        Measurement(index=i, box_xyxy_px=box, score=0.9, position_m=np.ones(3), forward_m=3.0)
        for i in range(found)
    )
    return Observation(
        stamp_ns=time_ns,
        measurements=people,
        camera=camera,
        map_from_camera=POSE,
        edges=ImageEdges(left=-0.5, right=0.5, top=-0.4, bottom=0.4),
    )


def run(
    watch: CameraAbsence,
    seconds: range,
    cameras: dict[str, int],
    people: tuple[Track, ...] = (track(),),
) -> int:
    """Add ten frames a second of each camera with a number of people; return the time."""
    now_ns = 0
    for k in range(seconds.start * 10, seconds.stop * 10):
        now_ns = k * 100 * MS
        for camera, found in cameras.items():
            watch.add_frame(observation(camera, now_ns, found), people, now_ns)
    return now_ns


def test_camera_that_sends_nothing_is_reported_until_it_sends() -> None:
    watch = CameraAbsence()
    run(watch, range(10), {"a": 1, "b": 1})
    now_ns = run(watch, range(10, 14), {"a": 1})
    assert watch.reasons(now_ns) == ["no detections arrive from camera b, while others send"]
    now_ns = run(watch, range(14, 15), {"a": 1, "b": 1})
    assert watch.reasons(now_ns) == []


def test_cameras_that_all_stop_are_not_compared() -> None:
    watch = CameraAbsence()
    now_ns = run(watch, range(10), {"a": 1, "b": 1})
    assert watch.reasons(now_ns + 20 * S) == []


def test_slow_camera_is_not_silent() -> None:
    # One frame in 2 s: 20 s without one are not too many.
    watch = CameraAbsence()
    for k in range(20):
        watch.add_frame(observation("slow", 2 * k * S, 1), (), 2 * k * S)
        watch.add_frame(observation("fast", 2 * k * S, 1), (), 2 * k * S)
    watch.add_frame(observation("fast", 48 * S, 1), (), 48 * S)
    assert watch.reasons(48 * S) == []


def test_covered_camera_is_reported() -> None:
    # Five samples a second: of 25 s with one person 75 have left the window of 10 s when it begins.
    watch = CameraAbsence()
    run(watch, range(25), {"a": 1, "b": 1})
    now_ns = run(watch, range(25, 40), {"a": 1, "b": 0})
    assert watch.reasons(now_ns) == ["camera b detects no person in its view: is it covered?"]
    now_ns = run(watch, range(40, 41), {"a": 1, "b": 1})
    assert watch.reasons(now_ns) == []


@pytest.mark.parametrize(
    ("found_before", "people"),
    [
        (0, (track(),)),  # behind a wall: people were never in view
        (1, (track(9.0),)),  # beyond the range of depth
        (1, (track(3.0, 1.4),)),  # at the edge of the image
        (1, ()),  # no people
    ],
)
def test_camera_without_people_in_view_is_not_covered(
    found_before: int, people: tuple[Track, ...]
) -> None:
    watch = CameraAbsence()
    run(watch, range(25), {"a": 1, "b": found_before})
    now_ns = run(watch, range(25, 40), {"a": 1, "b": 0}, people)
    assert watch.reasons(now_ns) == []
