"""Calibration by walking: correct poses and clocks, and refusals that name the missing input."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from common.calibration.observations import CameraObservations, ObservationCollector
from common.calibration.solve import CalibrationResult, calibrate
from common.geometry.transforms import invert
from people4d.errors import CalibrationError
from tests.common.calibration.walks import WalkCamera, camera, messages, observe, square, wander


def errors(found: CalibrationResult, cameras: Sequence[WalkCamera]) -> tuple[float, float, float]:
    """Return the largest errors of position [m], rotation [deg] and clock [ms]."""
    true = {c.name: c for c in cameras}
    reference = true[found.reference]
    worst = np.zeros(3)
    for name, pose in found.poses.items():
        expected = invert(reference.map_from_camera) @ true[name].map_from_camera
        error = invert(expected) @ pose.matrix
        angle = np.degrees(np.arccos(np.clip((np.trace(error[:3, :3]) - 1) / 2, -1, 1)))
        late_ms = 1e3 * abs(pose.offset_s - (true[name].offset_s - reference.offset_s))
        of_camera = [float(np.linalg.norm(error[:3, 3])), float(angle), late_ms]
        worst = np.maximum(worst, of_camera)
    position_m, angle_deg, late_ms = worst.tolist()
    return position_m, angle_deg, late_ms


def refusal(observed: Sequence[CameraObservations]) -> str:
    with pytest.raises(CalibrationError) as error:
        calibrate(observed)
    return str(error.value)


@pytest.mark.parametrize(("people", "duration_s", "limit_m"), [(1, 40.0, 0.08), (2, 20.0, 0.03)])
def test_people_who_walk_show_poses_clocks_and_floor(
    people: int, duration_s: float, limit_m: float
) -> None:
    cameras = square("a", "b", "c", "d")
    found = calibrate(observe(cameras, [wander(3 + k) for k in range(people)], duration_s))
    position_m, angle_deg, late_ms = errors(found, cameras)
    assert position_m < limit_m
    assert angle_deg < 1.0
    assert late_ms < 10
    # The map is on the floor below the reference, x where it looks.
    own, true = found.map_from_camera["a"], cameras[0].map_from_camera
    np.testing.assert_allclose(own[2, :3], true[2, :3], atol=0.01)
    np.testing.assert_allclose(own[:3, 3], [0, 0, 2.2], atol=0.03)
    assert own[1, 2] == pytest.approx(0, abs=1e-9)
    assert own[0, 2] > 0.9
    assert not found.contradicting


def test_positions_on_the_surface_of_people_do_not_move_the_cameras() -> None:
    cameras = [replace(c, near_m=0.1) for c in square("a", "b", "c", "d")]
    found = calibrate(observe(cameras, [wander(3), wander(4)]))
    position_m, angle_deg, _ = errors(found, cameras)
    assert position_m < 0.05  # 0.2 m between opposite cameras if nothing was corrected
    assert angle_deg < 1.0
    assert all(pose.bias_m == pytest.approx(0.1, abs=0.03) for pose in found.poses.values())


def test_standard_deviations_cover_the_errors() -> None:
    cameras = square("a", "b", "c")
    found = calibrate(observe(cameras, [wander(5), wander(6)]))
    position_m, angle_deg, late_ms = errors(found, cameras)
    pose = max(found.poses.values(), key=lambda p: p.sigma_m)
    assert 0 < pose.sigma_m < 0.03
    assert position_m < 5 * pose.sigma_m
    assert angle_deg < 5 * np.degrees(pose.sigma_rad)
    assert late_ms < 5 * 1e3 * pose.sigma_s + 1


def test_known_pose_of_the_reference_stays_as_it_is() -> None:
    cameras = square("a", "b")
    true = cameras[1].map_from_camera
    found = calibrate(observe(cameras, [wander(3), wander(4)], 40.0), "b", true)
    np.testing.assert_array_equal(found.map_from_camera["b"], true)
    np.testing.assert_allclose(found.map_from_camera["a"], cameras[0].map_from_camera, atol=0.04)


def test_chain_of_neighbours_is_calibrated_through_them() -> None:
    cameras = [camera(name, 2.0 * k, 0.0, 90.0) for k, name in enumerate("abc")]

    def path(seed: int):  # type: ignore[no-untyped-def]  # along the row, 2.4 to 4 m before it
        own = wander(seed, 1.0)
        return lambda t: (2.0 + 3.2 * np.sin(0.2 * t + seed) + 0.3 * own(t)[0], 3.2 + own(t)[1])

    found = calibrate(observe(cameras, [path(1), path(4)], 40.0, noise_m=0.01))
    position_m, angle_deg, _ = errors(found, cameras)
    assert position_m < 0.08
    assert angle_deg < 1.5


def test_no_camera_and_one_camera_are_refused() -> None:
    assert "no camera sends detections" in refusal([])
    assert "only a sends detections" in refusal(observe(square("a"), [wander(1)]))


def test_people_who_are_absent_or_stand_are_refused() -> None:
    assert "a and b saw people for less than" in refusal(observe(square("a", "b"), []))
    standing = [lambda _: (0.5, 0.2), lambda _: (-0.6, 0.3)]
    assert "no person walked before a and b" in refusal(observe(square("a", "b"), standing))


def test_cameras_that_never_share_a_person_are_named() -> None:
    cameras = [*square("a", "b"), camera("z", 20.0, 0.0, 0.0)]
    far, near = wander(7, 1.0), [wander(3), wander(4)]
    people = [*near, lambda t: (far(t)[0] + 23.2, far(t)[1])]
    said = refusal(observe(cameras, people))
    assert "z shared no person with a and b" in said or "z fit in two ways" in said
    assert "z" in said.partition("alk")[2]


def test_walk_that_is_the_same_when_turned_is_refused() -> None:
    path = wander(9)
    turned = [path, lambda t: (-path(t)[0], -path(t)[1])]
    assert "fit in two ways" in refusal(observe(square("a", "c"), turned, 40.0))


def test_straight_walk_at_one_speed_is_refused() -> None:
    # Along one line position and clock cannot be told apart.
    said = refusal(observe(square("a", "b"), [lambda t: (-1.6 + 0.8 * (t % 4.0), 0.3)]))
    assert any(text in said for text in ("two ways", "too uncertain", "for long enough"))


def test_two_cameras_of_one_name_are_refused() -> None:
    twins = [camera("b", 3.0, -3.0, 135.0), camera("b", 3.0, 3.0, -135.0, offset_s=0.03)]
    sent = [m for c in [*square("a"), *twins] for m in messages([c], [wander(3), wander(4)])]
    collector = ObservationCollector()
    for arrived_ns, message in sorted(sent, key=lambda item: item[0]):
        collector.add_message(message, arrived_ns)
    assert "two cameras or robots are named b" in refusal(collector.cameras)


def test_wrong_focal_length_is_refused_and_named() -> None:
    cameras = square("a", "b", "c", "d")
    cameras[2] = WalkCamera("c", cameras[2].map_from_camera, 12.0, -0.13, scale=1.12)
    said = refusal(observe(cameras, [wander(3), wander(4)]))
    assert "intrinsics of c do not fit" in said
    assert "focal length" in said


def test_refused_calibration_leaves_its_input_as_it_was() -> None:
    observed = observe(square("a", "c"), [lambda _: (0.0, 0.0)])
    before = [len(c.frames) for c in observed]
    refusal(observed)
    assert [len(c.frames) for c in observed] == before


def test_unknown_reference_is_refused() -> None:
    with pytest.raises(CalibrationError, match="unknown camera x"):
        calibrate(observe(square("a", "b"), [wander(3)]), "x")
