"""The floor in the depth of cameras: alone, and in a calibration by walking."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from common.calibration.floor import MeasuredFloor, find_floor, thinned
from common.calibration.observations import CameraObservations, ObservationCollector
from common.calibration.solve import CalibrationResult, calibrate
from people4d.messages import U16
from tests.builders import camera_info
from tests.common.calibration.walks import (
    WalkCamera,
    camera,
    floor_depth_mm,
    messages,
    square,
    wander,
)

ONE = camera("a", 0.0, 0.0, 0.0)
UP = ONE.map_from_camera[2, :3]  # of the map, in its optical frame
INFO = camera_info(camera="a")
LEVEL: dict[str, Any] = {}


def found_in(*images_mm: U16) -> MeasuredFloor | None:
    """Return the floor from people with errors of 3 cm and half a degree."""
    up = UP + np.array([0.006, -0.006, 0.0])
    return find_floor([thinned(mm) for mm in images_mm], INFO, up / np.linalg.norm(up), 2.23)


def images(count: int = 5, **options: Any) -> list[U16]:
    return [floor_depth_mm(ONE, seed=k, **options) for k in range(count)]


def test_floor_is_found_within_millimetres() -> None:
    floor = found_in(*images())
    assert floor is not None
    assert np.degrees(np.arccos(floor.up @ UP)) < 0.05
    assert floor.camera_m == pytest.approx(2.2, abs=0.004)
    assert 0.002 < floor.sigma_m < 0.02
    assert 0.002 < floor.sigma_rad < 0.01


def test_table_beside_it_is_not_the_floor() -> None:
    floor = found_in(*images(table=True))
    assert floor is not None
    assert floor.camera_m == pytest.approx(2.2, abs=0.01)


@pytest.mark.parametrize(
    "options",
    [{"level_m": 0.75}, {"tilt_deg": 5.0}, {"level_m": -0.6}],
    ids=["only a table top", "a ramp", "a pit"],
)
def test_other_surfaces_are_not_the_floor(options: dict[str, Any]) -> None:
    assert found_in(*images(**options)) is None


def test_view_without_floor_or_depth_has_none() -> None:
    nothing, wall = np.zeros((480, 640), np.uint16), np.full((480, 640), 1500, np.uint16)
    for depths in ([nothing] * 5, [wall] * 5, [], images(2), [mm[:240] for mm in images()]):
        assert found_in(*depths) is None


def test_people_who_pass_do_not_hide_it() -> None:
    several = images(7)
    for k, image in enumerate(several):
        image[:, 80 * k : 80 * k + 200] = 1800
    floor = found_in(*several)
    assert floor is not None
    assert floor.camera_m == pytest.approx(2.2, abs=0.01)


def observe(
    cameras: Sequence[WalkCamera], floors: Mapping[str, dict[str, Any]], duration_s: float = 15.0
) -> list[CameraObservations]:
    """Return the views of two people by all cameras, and of the floor by the named cameras."""
    collector = ObservationCollector()
    for arrived_ns, message in messages(cameras, [wander(3), wander(4)], duration_s):
        collector.add_message(message, arrived_ns)
    for one in cameras:
        for k in range(5 if one.name in floors else 0):
            collector.add_depth(one.name, k, floor_depth_mm(one, seed=k, **floors[one.name]))
    return collector.cameras


def off(found: CalibrationResult, cameras: Sequence[WalkCamera]) -> tuple[float, float]:
    """Return the worst tilt [deg] and height [m] of cameras."""
    pairs = [(found.map_from_camera[c.name], c.map_from_camera) for c in cameras]
    tilts = [np.arccos(np.clip(own[2, :3] @ true[2, :3], -1, 1)) for own, true in pairs]
    heights = [abs(own[2, 3] - true[2, 3]) for own, true in pairs]
    return float(np.degrees(max(tilts))), float(max(heights))


@pytest.mark.parametrize("named", ["abc", "b"])
def test_floor_in_depth_shows_tilt_and_height_of_all_cameras(named: str) -> None:
    cameras = square("a", "b", "c")
    found = calibrate(observe(cameras, dict.fromkeys(named, LEVEL)))
    tilt_deg, height_m = off(found, cameras)
    assert tilt_deg < (0.1 if named == "abc" else 0.35)
    assert height_m < (0.01 if named == "abc" else 0.02)
    assert sorted(found.adjustment.floor_cameras) == list(named)
    assert not found.adjustment.odd_floors


@pytest.mark.parametrize("options", [{"level_m": 0.12}, {"tilt_deg": 2.0}], ids=["stage", "ramp"])
def test_floor_of_another_level_is_left_out_and_named(options: dict[str, Any]) -> None:
    cameras = square("a", "b", "c")
    floors = {**dict.fromkeys("ab", LEVEL), "c": options}
    found = calibrate(observe(cameras, floors, 25.0))
    assert found.adjustment.odd_floors == ["c"]
    tilt_deg, height_m = off(found, cameras)
    assert tilt_deg < 0.35
    assert height_m < 0.03


def test_two_floors_that_contradict_each_other_are_both_left_out() -> None:
    cameras = square("a", "b", "c")
    floors = {"a": LEVEL, "c": {"level_m": 0.15}}
    found = calibrate(observe(cameras, floors))
    assert sorted(found.adjustment.odd_floors) == ["a", "c"]
    assert found.adjustment.floor is None
    assert found.floor_people > 0
