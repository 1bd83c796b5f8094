"""The depth sensor: law of its noise, shadows by geometry, no invented readings."""

import msgspec
import numpy as np
import pytest

from lab.depth.config import DepthSensorModel, SensorChanges
from lab.depth.noise import Persistence
from lab.depth.sensor import DepthSensor
from people4d.errors import ConfigError
from people4d.messages import F32, U16, CameraInfo
from tests import builders
from tests.lab.depth.sensors import EXACT, correlation

NOISY = msgspec.structs.replace(EXACT, noise_px=0.07)


def info(width: int = 160, height: int = 120) -> CameraInfo:
    return builders.camera_info(width=width, height=height, cx=80.0, cy=60.0)


def wall(depth_m: float, calibration: CameraInfo | None = None) -> F32:
    calibration = calibration or info()
    return np.full((calibration.height, calibration.width), depth_m, np.float32)


def sensor(config: DepthSensorModel, seed: int = 5) -> DepthSensor:
    return DepthSensor(config, info(), seed)


def box() -> F32:
    """A wall at 3 m, and before it a box at 1 m in columns 80 to 119, rows 30 to 89."""
    depth_m = wall(3.0)
    depth_m[30:90, 80:120] = 1.0
    return depth_m


@pytest.mark.slow
def test_exact_sensor_rounds_to_millimetres() -> None:
    depth_mm = np.random.default_rng(1).integers(1, 65_000, (120, 160)).astype(np.uint16)
    depth_m = depth_mm.astype(np.float32) / np.float32(1000)
    assert np.array_equal(sensor(EXACT).measure(depth_m, None, 3.0), depth_mm)


@pytest.mark.slow
def test_nothing_is_read_where_nothing_is() -> None:
    depth_m = wall(2.0)
    depth_m[:40], depth_m[40:60], depth_m[60:70], depth_m[70:80] = np.inf, 0, np.nan, -1
    reading = sensor(msgspec.structs.replace(DepthSensorModel(), ragged_px=0)).measure(
        depth_m, depth_m, 0.5
    )
    assert not reading[:80].any()
    assert reading[80:].any()
    for nothing in (0.0, np.inf):
        assert not sensor(DepthSensorModel()).measure(wall(nothing), None, 1.0).any()


@pytest.mark.slow
@pytest.mark.parametrize("depth_m", [1.0, 2.0, 3.0, 4.0])
def test_noise_grows_with_the_square_of_the_distance(depth_m: float) -> None:
    # z^2 s / (f b): 1 m: 0.07 / (385 * 0.05) = 3.64 mm; 2 m: 14.5; 3 m: 32.7; 4 m: 58.2 mm.
    expected_mm = depth_m**2 * 0.07 / (385 * 0.05) * 1000
    camera = sensor(NOISY)
    readings = np.stack([camera.measure(wall(depth_m), None, k * 1.0) for k in range(10)])
    error_mm = readings.astype(float) - depth_m * 1000
    assert np.sqrt(np.mean(error_mm**2)) == pytest.approx(expected_mm, rel=0.05)
    # z = f b / d is curved: an error s shifts the mean by z (s z / (f b))^2, 0.8 mm at 4 m.
    assert abs(error_mm.mean()) < 0.12 * expected_mm
    assert NOISY.noise_m(depth_m) == pytest.approx(expected_mm / 1000)


def test_noise_lasts_as_configured() -> None:
    config = msgspec.structs.replace(NOISY, frozen_share=0.35, correlation_s=0.1)
    persistence = Persistence(frozen_share=0.35, correlation_s=0.1)
    camera = sensor(config)
    errors = np.stack([camera.measure(wall(3.0), None, k / 30) for k in range(60)]) - 3000.0
    for lag in (1, 2, 4, 8):
        measured = np.mean(errors[lag:] * errors[:-lag]) / np.mean(errors**2)
        assert measured == pytest.approx(correlation(persistence, lag / 30), abs=0.04)


def test_noise_is_partly_smooth_over_the_image() -> None:
    errors = sensor(NOISY).measure(wall(3.0), None, 0.0).astype(float) - 3000
    neighbours = np.mean(errors[:, 1:] * errors[:, :-1]) / np.mean(errors**2)
    # The white share, 0.3, is not shared by neighbours; of the rest nearly all.
    assert 0.55 < neighbours < 0.75
    assert abs(np.mean(errors[:, 60:] * errors[:, :-60]) / np.mean(errors**2)) < 0.1


@pytest.mark.slow
def test_disparity_has_steps() -> None:
    # Whole steps of 1/32 px: z = 385 * 0.05 / (k / 32) = 616 / k metres. 3 m lies between
    # k = 205 (3.005 m) and k = 206 (2.990 m).
    config = msgspec.structs.replace(NOISY, step_px=1 / 32)
    readings = set(sensor(config).measure(wall(3.0), None, 0.0).ravel().tolist())
    allowed = {round(616_000 / k) for k in range(150, 280)}
    assert readings <= allowed
    assert {3005, 2990} <= readings
    still = msgspec.structs.replace(EXACT, step_px=1 / 32)
    assert set(sensor(still).measure(wall(3.0), None, 0.0).ravel().tolist()) == {3005}


def shadow_columns(reading: U16, row: int = 60) -> list[int]:
    return np.flatnonzero(reading[row] == 0).tolist()


def test_shadow_lies_left_of_a_near_object() -> None:
    # The right imager sees a point at depth z shifted to the left by f b / z: the box at 1 m by
    # 600 * 0.05 / 1 = 30 px, the wall at 3 m by 10 px. The box's columns 80..119 come to 50..89;
    # the wall's column u comes to u - 10, hidden if 50 <= u - 10 < 90: u = 60..99. Of these, in
    # the left view, the box itself covers 80..119: a shadow at 60..79, 30 - 10 = 20 px wide.
    config = msgspec.structs.replace(EXACT, shadow=True)
    shadow = shadow_columns(sensor(config).measure(box(), None, 0.0))
    assert shadow == list(range(shadow[0], 80))
    assert len(shadow) == pytest.approx(20, abs=1)
    # The same with the right view drawn: a wall, and before it the box in columns 50..89.
    right_m = wall(3.0)
    right_m[30:90, 50:90] = 1.0
    assert shadow_columns(sensor(config).measure(box(), right_m, 0.0)) == list(range(60, 80))
    assert not shadow_columns(sensor(EXACT).measure(box(), right_m, 0.0))


def test_object_outside_the_image_casts_a_shadow_into_it() -> None:
    # Columns 160..199 of the box are outside; in the right view they come to 130..169.
    right_m = wall(3.0)
    right_m[:, 130:] = 1.0
    config = msgspec.structs.replace(EXACT, shadow=True)
    shadow = shadow_columns(sensor(config).measure(wall(3.0), right_m, 0.0))
    assert shadow == list(range(140, 160))


def test_left_band_is_as_wide_as_the_disparity() -> None:
    # 600 * 0.05 / 3 = 10 px: column 9 would come to -1 in the right view, column 10 to 0.
    config = msgspec.structs.replace(EXACT, left_band=True)
    assert shadow_columns(sensor(config).measure(wall(3.0), None, 0.0)) == list(range(10))


@pytest.mark.slow
def test_range_is_limited() -> None:
    config = msgspec.structs.replace(EXACT, min_depth_m=0.28, max_depth_m=5.0)
    for depth_m, in_view in ((0.27, False), (0.29, True), (4.99, True), (5.01, False)):
        assert sensor(config).measure(wall(depth_m), None, 0.0).any() == in_view


def test_holes_have_their_share() -> None:
    config = msgspec.structs.replace(EXACT, holes=0.05)
    camera = sensor(config)
    share = np.mean([camera.measure(wall(2.0), None, k * 1.0) == 0 for k in range(40)])
    assert share == pytest.approx(0.05, abs=0.012)


@pytest.mark.slow
def test_edges_are_ragged_and_holed() -> None:
    ragged = sensor(msgspec.structs.replace(EXACT, ragged_px=1.2)).measure(box(), None, 0.0)
    borders = {int(np.flatnonzero(row == 1000)[0]) for row in ragged[35:85]}
    assert len(borders) > 2
    assert min(borders) >= 74
    assert max(borders) <= 86
    assert set(np.unique(ragged)) == {1000, 3000}  # no reading between the two surfaces

    holed = sensor(msgspec.structs.replace(EXACT, edge_holes=0.4)).measure(box(), None, 0.0)
    rim = np.concatenate([holed[31:89, 80], holed[31:89, 119], holed[30, 80:120]])
    assert 0.1 < np.mean(rim == 0) < 0.7
    assert not (holed[35:85, 85:115] == 0).any()


def test_readings_fail_at_grazing_angles() -> None:
    # Depth grows by 0.035 m a column: the tangent of the angle is 600 px * 0.035 m / z = 21 / z.
    # z = 1 m (column 0): 21, far beyond 8; z = 2.625 m (column 46): 8; z = 5.9 m (column 140): 3.6.
    depth_m = wall(1.0) + 0.035 * np.arange(160, dtype=np.float32)
    grazing = msgspec.structs.replace(EXACT, holes=1e-6, edge_gap=1.0)
    camera = sensor(grazing)
    lost = np.mean([camera.measure(depth_m, None, k * 1.0) == 0 for k in range(20)], axis=(0, 1))
    assert lost[:10].min() == 1
    assert lost[46] == pytest.approx(0.5, abs=0.12)
    assert lost[140:].max() == 0
    never = msgspec.structs.replace(grazing, holes=0)
    assert sensor(never).measure(depth_m, None, 0.0).all()


def test_scale_and_shift() -> None:
    config = msgspec.structs.replace(EXACT, scale_bias=0.02, shift_px=(3.0, -2.0))
    reading = sensor(config).measure(box(), None, 0.0)
    # 1 m * 1.02 = 1020 mm; the box moves 3 columns to the right and 2 rows up.
    rows, columns = np.nonzero(reading == 1020)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (28, 87, 83, 122)


def test_same_stamp_same_bytes_in_any_order() -> None:
    stamps = [0.0, 0.4, 1 / 30, 12.0, 1.7e9]
    fresh = [sensor(DepthSensorModel()).measure(box(), None, t).tobytes() for t in stamps]
    one = sensor(DepthSensorModel())
    assert [one.measure(box(), None, t).tobytes() for t in reversed(stamps)] == fresh[::-1]
    assert len(set(fresh)) == len(stamps)
    assert sensor(DepthSensorModel(), seed=6).measure(box(), None, 0.0).tobytes() != fresh[0]


@pytest.mark.parametrize(
    ("change", "error_text"),
    [
        ({"noise_px": -1.0}, "noise_px: expected"),
        ({"holes": 2.0}, "holes: expected"),
        ({"scale_bias": 0.5}, "scale_bias: expected"),
        ({"noise_px": float("nan")}, "noise_px: expected"),
    ],
)
def test_changes_are_checked(change: dict[str, float], error_text: str) -> None:
    with pytest.raises(ValueError, match=error_text):
        SensorChanges(**change)  # type: ignore[arg-type]


def test_contradicting_limits_of_depth_are_refused() -> None:
    with pytest.raises(ConfigError, match="min < max"):
        SensorChanges(min_depth_m=6.0).change_model(DepthSensorModel())


@pytest.mark.parametrize(
    ("stored", "error_text"),
    [
        ({"baseline_m": 0.0}, "baseline_m"),
        ({"grain_px": 0}, "grain_px"),
        ({"grain_share": 0.9}, "at most 1"),
    ],
)
def test_stored_model_is_checked(stored: dict[str, float], error_text: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=error_text):
        msgspec.convert(stored, DepthSensorModel)
