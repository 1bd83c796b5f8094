"""Detection of floors, and their removal from bodies."""

import numpy as np
import pytest

from people4d.messages import F64, U16
from services.gait.surface import floor as floor_module
from services.gait.surface.floor import FloorDetector, FloorPlane
from tests.gait.builders import INFO

V, U = np.mgrid[: INFO.height, : INFO.width].astype(np.float64)
RAYS = np.stack([(U - INFO.cx) / INFO.fx, (V - INFO.cy) / INFO.fy, np.ones_like(U)], axis=-1)
WALL_M = 4.0
BOX = np.array([280.0, 100.0, 360.0, 470.0])
ALL = np.array([0.0, 0.0, 640.0, 480.0])


def room(camera_m: float = 1.0, tilt_deg: float = 0.0) -> U16:
    """A floor and a wall at 4 m, in mm; the camera looks down by the tilt."""
    up = up_of(tilt_deg)
    falls = -(RAYS @ up)
    floor = np.where(falls > 1e-6, camera_m / np.maximum(falls, 1e-6), np.inf)
    return np.asarray(np.rint(1000 * np.minimum(floor, WALL_M)), np.uint16)


def up_of(tilt_deg: float) -> F64:
    tilt = np.radians(tilt_deg)
    return np.array([0.0, -np.cos(tilt), -np.sin(tilt)])


def assert_is(floor: FloorPlane | None, camera_m: float, tilt_deg: float) -> None:
    """Assert a floor to a degree and 3 cm: points at the foot of the wall count, too."""
    assert floor is not None
    assert np.degrees(np.arccos(min(float(floor.up @ up_of(tilt_deg)), 1.0))) < 1.0
    assert floor.camera_m == pytest.approx(camera_m, abs=0.03)


def found(depth_mm: U16) -> FloorPlane | None:
    return FloorDetector(INFO).update_floor(depth_mm)


@pytest.mark.parametrize(("camera_m", "tilt_deg"), [(1.0, 0.0), (0.4, -10.0), (1.6, 25.0)])
def test_a_floor_is_found(camera_m: float, tilt_deg: float) -> None:
    assert_is(found(room(camera_m, tilt_deg)), camera_m, tilt_deg)


def test_a_floor_is_found_in_the_noise_of_a_stereo_camera() -> None:
    # 2.5 mm at 1 m, 40 mm at 4 m, and a tenth without a reading.
    random = np.random.default_rng(0)
    depth_m = room(1.0, 15.0) / 1000
    noisy = depth_m + random.normal(0, 0.0025, depth_m.shape) * depth_m**2
    noisy[random.random(depth_m.shape) < 0.1] = 0
    assert_is(found(np.rint(1000 * noisy).astype(np.uint16)), 1.0, 15.0)


def test_heights_by_hand() -> None:
    # Camera 1 m above a level floor, y down: 0.8 m below it is 0.2 m high.
    floor = FloorPlane(np.array([0.0, -1.0, 0.0]), 1.0)
    heights = floor.heights_m(np.array([[0.3, 0.8, 2.0], [0.0, 1.0, 3.0], [0.0, -0.5, 1.0]]))
    assert heights == pytest.approx([0.2, 0.0, 1.5])


@pytest.mark.parametrize(
    "depth",
    [
        pytest.param(np.zeros((480, 640), np.uint16), id="no depth"),
        pytest.param(np.full((480, 640), 2000, np.uint16), id="a wall"),
        pytest.param(room(1.0, 60.0), id="too steep"),
        pytest.param(room()[:240, :320], id="of another size"),
    ],
)
def test_scene_without_floor_gives_none(depth: U16) -> None:
    assert found(depth) is None


def test_a_table_is_no_floor() -> None:
    # A table 0.5 m below the camera takes a tenth of the view; the floor is 1 m below.
    depth = room()
    table = np.rint(1000 * 0.5 / np.maximum(RAYS[..., 1], 1e-6))
    shows = (V > 360) & (U < 250)
    depth[shows] = table[shows].astype(np.uint16)
    assert_is(found(depth), 1.0, 0.0)


def test_floor_persists_while_occluded_and_follows_the_camera(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(floor_module, "PERIOD", 1)
    detector = FloorDetector(INFO)
    first = detector.update_floor(room(1.0, 10.0))
    assert detector.update_floor(np.zeros((480, 640), np.uint16)) is first
    assert first is not None
    for tilt_deg in (12.0, 20.0, 2.0):  # little by little, and with a jerk
        assert_is(detector.update_floor(room(1.2, tilt_deg)), 1.2, tilt_deg)


def test_floor_is_detected_every_tenth_frame() -> None:
    detector = FloorDetector(INFO)
    detector.update_floor(room(1.0))
    estimate = [detector.update_floor(room(1.3)) for _ in range(10)]
    assert [round(floor.camera_m, 1) for floor in estimate if floor] == [*[1.0] * 9, 1.3]


def test_removal_leaves_legs_above_the_floor() -> None:
    # A person's legs 2.5 m away, from 0 to 0.5 m above the floor: rows 340 to 440 of a camera 1 m
    # high. Within 35 mm of the floor, and twice the noise of 2.5 mm times 2.5^2 along a ray that
    # falls by 0.4: 41 mm, which is 8 rows.
    depth = room()
    depth[340:440, 300:340] = 2500
    detector = FloorDetector(INFO)
    detector.update_floor(depth)
    cut = detector.remove_floor(depth, BOX)
    legs = cut[340:440, 300:340]
    rows = np.flatnonzero((legs == 2500).all(axis=1))
    assert rows.tolist() == list(range(len(rows)))
    assert len(rows) == pytest.approx(92, abs=1)
    assert not legs[len(rows) :].any()
    assert not cut[445:470, 280:360].any()  # nothing but floor
    assert np.array_equal(cut[:300], depth[:300])  # the wall is unchanged
    assert np.array_equal(cut[:, :270], depth[:, :270])  # pixels outside the box are unchanged


def test_removal_does_not_change_the_input() -> None:
    depth = room()
    before = depth.copy()
    depth.flags.writeable = False
    detector = FloorDetector(INFO)
    detector.update_floor(depth)
    detector.remove_floor(depth, ALL)
    assert np.array_equal(depth, before)


@pytest.mark.parametrize(
    "box", [[np.nan, 0, 10, 10], [-50, -50, -10, -10], [900, 900, 990, 990], [10, 10, 10, 10]]
)
def test_invalid_boxes_remove_nothing(box: list[float]) -> None:
    detector = FloorDetector(INFO)
    depth = room()
    detector.update_floor(depth)
    cut = detector.remove_floor(depth, np.array(box, float))
    assert np.count_nonzero(cut != depth) <= 2
