"""Watch of camera poses: only a displaced camera is named."""

import math
from dataclasses import replace

import numpy as np
import pytest

from common.geometry.transforms import (
    LINK_FROM_OPTICAL,
    apply,
    invert,
    rotation_from_rpy,
    transform_from,
)
from people4d.messages import F64, Track
from services.tracker.cameras.drift import CameraDrift
from services.tracker.interface import Measurement, Observation

BOX = np.array([0, 0, 10, 20], np.float32)
POSES = {
    name: transform_from((x, y, 2.2), rotation_from_rpy(0, 0.25, math.radians(yaw)))
    @ LINK_FROM_OPTICAL
    for name, x, y, yaw in (("a", -3, -3, 45), ("b", 3, -3, 135), ("c", 3, 3, -135))
}


def people(t_s: float) -> F64:
    """Positions of two people walking at a distance of 3 m."""
    x, y = 1.2 * math.sin(0.5 * t_s), 0.8 * math.sin(0.37 * t_s)
    return np.array([[x - 1.5, y, 1.1], [x + 1.5, -y, 1.1]])


def observation(
    camera: str, t_s: float, believed: F64, true: F64, rng: np.random.Generator
) -> Observation:
    """Observation of a camera at pose `true` with the calibration `believed`."""
    optical = apply(invert(true), people(t_s)) + rng.normal(0, 0.04, (2, 3))
    measurements = tuple(
        Measurement(index=k, box_xyxy_px=BOX, score=0.9, position_m=at, forward_m=3.0)
        for k, at in enumerate(apply(believed, optical))
    )
    return Observation(
        stamp_ns=round(t_s * 1e9),
        measurements=measurements,
        camera=camera,
        map_from_camera=believed,
    )


def track_of(detection: int, velocity_mps: F64) -> Track:
    return Track(
        id=detection + 1,
        state="confirmed",
        position_m=np.zeros(3),
        velocity_mps=velocity_mps,
        yaw_rad=None,
        covariance=np.eye(6),
        hits=9,
        age=9,
        time_since_update_s=0.0,
        detection=detection,
        score=0.9,
    )


def watch(true: dict[str, F64], seconds: float = 40.0, others: float = 0.0) -> CameraDrift:
    """Run the watch; in a share of the frames positions belong to another person, 0.8 m away."""
    drift, rng = CameraDrift(), np.random.default_rng(1)
    for k in range(int(seconds * 10)):
        for number, camera in enumerate(true):
            t_s = k * 0.1 + 0.03 * number
            view = observation(camera, t_s, POSES[camera], true[camera], rng)
            if rng.random() < others:
                beside = rng.normal(size=2)
                beside *= 0.8 / np.linalg.norm(beside)
                aside = tuple(
                    replace(m, position_m=m.position_m + np.append(beside, 0.0))
                    for m in view.measurements
                )
                view = replace(view, measurements=aside)
            drift.add_frame(view)
    return drift


def turned(camera: str, degrees: float) -> dict[str, F64]:
    """Return the true poses after one camera was turned about the vertical."""
    pose = POSES[camera].copy()
    pose[:3, :3] = rotation_from_rpy(0, 0, math.radians(degrees)) @ pose[:3, :3]
    return {**POSES, camera: pose}


def test_samples_of_a_camera_stay_when_its_stamps_are_corrected() -> None:
    drift, rng, ahead_s = CameraDrift(), np.random.default_rng(1), 0.1
    for k in range(300):
        for number, camera in enumerate("ab"):
            t_s = k * 0.1 + 0.03 * number
            view = observation(camera, t_s, POSES[camera], POSES[camera], rng)
            velocities = (people(t_s + 0.01) - people(t_s - 0.01)) / 0.02
            walks = [track_of(number, v) for number, v in enumerate(velocities)]
            at_s = t_s + ahead_s * (camera == "b")
            drift.add_frame(replace(view, stamp_ns=round(at_s * 1e9)), walks)
    found = drift.stamp_errors("a", round(at_s * 1e9))["b"]
    assert found.ahead_s == pytest.approx(ahead_s, abs=3 * found.sigma_s)
    drift.restamp("b", round(ahead_s * 1e9))
    again = drift.stamp_errors("a", round((at_s + 3) * 1e9))["b"]
    assert again.ahead_s == pytest.approx(found.ahead_s - ahead_s, abs=0.005)
    assert again.sigma_s == pytest.approx(found.sigma_s, rel=0.1)


def test_cameras_where_they_should_be_are_not_reported() -> None:
    drift = watch(POSES)
    assert drift.movement is None
    assert drift.reasons() == []


@pytest.mark.parametrize("camera", ["a", "b", "c"])
def test_camera_knocked_by_five_degrees_is_named(camera: str) -> None:
    found = watch(turned(camera, 5.0)).movement
    assert found is not None
    assert found.camera == camera
    assert found.moved_m > 0.12


@pytest.mark.parametrize("degrees", [0.0, 5.0])
def test_confused_people_neither_hide_nor_cause_a_movement(degrees: float) -> None:
    found = watch(turned("b", degrees), others=0.1).movement
    assert (found.camera if found else None) == ("b" if degrees else None)


def test_of_two_cameras_either_may_have_moved() -> None:
    true = turned("b", 5.0)
    drift = watch({"a": true["a"], "b": true["b"]})
    (reason,) = drift.reasons()
    assert reason.startswith("camera a or b has moved by about ")
    assert "calibrate again" in reason


def test_watch_restarts_after_a_calibration() -> None:
    drift = watch(turned("c", 5.0))
    drift.clear()
    assert drift.reasons() == []


def test_single_camera_and_frames_without_pose_or_people_show_no_movement() -> None:
    drift, rng = CameraDrift(), np.random.default_rng(1)
    for k in range(100):
        drift.add_frame(observation("a", k * 0.1, POSES["a"], POSES["a"], rng))
        drift.add_frame(Observation(stamp_ns=k * 10**8, camera="b"))
        drift.add_frame(Observation(stamp_ns=k * 10**8, camera="c", map_from_camera=np.eye(4)))
    assert drift.movement is None


def test_people_who_stand_close_together_are_not_compared() -> None:
    drift, rng = CameraDrift(), np.random.default_rng(1)
    for k in range(200):
        for camera in POSES:
            frame = observation(camera, k * 0.1, POSES[camera], turned("c", 5.0)[camera], rng)
            crowd = tuple(
                Measurement(
                    index=n,
                    box_xyxy_px=BOX,
                    score=0.9,
                    position_m=np.add(frame.measurements[0].position_m, (0.5 * n, 0, 0)),
                    forward_m=3.0,
                )
                for n in range(3)
            )
            drift.add_frame(
                Observation(
                    stamp_ns=frame.stamp_ns,
                    measurements=crowd,
                    camera=camera,
                    map_from_camera=POSES[camera],
                )
            )
    assert drift.movement is None


def test_names_of_cameras_are_bounded() -> None:
    drift, rng = CameraDrift(), np.random.default_rng(1)
    for k in range(100):
        drift.add_frame(observation("a", 0.001 * k, POSES["a"], POSES["a"], rng))
        one = observation("b", 0.001 * k, POSES["b"], POSES["b"], rng)
        drift.add_frame(
            Observation(one.stamp_ns, one.measurements, f"x{k}", map_from_camera=POSES["b"])
        )
    assert len(drift._frames) <= 16
