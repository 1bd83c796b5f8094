"""Diagnostics of cameras whose frames, rate, stamps or calibration cannot be right."""

import numpy as np
import pytest

from people4d.messages import Detection
from tests import builders
from tests.common.diagnosis.test_checks import Heard

FAULT = "depth_mm is float32 (480, 640), expected uint16 (480, 640) millimetres"


@pytest.fixture
def heard() -> Heard:
    return Heard()


def standing(upright: bool = True) -> Detection:
    """A person 2 m away in an image of 64x48: 34 of 48 px tall, with fy 40 1.7 m."""
    keypoints = np.full((17, 3), (32, 20, 0.9), np.float32)
    keypoints[[5, 6], 1], keypoints[[11, 12], 1] = (12, 22) if upright else (22, 12)
    return Detection(
        box_xyxy_px=np.array([20, 6, 44, 40], np.float32),
        score=0.9,
        position_m=np.array([0.0, 0.0, 2.0]),
        keypoints=keypoints,
    )


def calibrate(heard: Heard, fx: float = 40.0, cx: float = 32.0) -> None:
    info = builders.camera_info(width=64, height=48, fx=fx, fy=fx, cx=cx, cy=24.0)
    heard.evidence.add_message(info, 0)


def test_rejected_frames_are_a_problem_with_what_is_wrong(heard: Heard) -> None:
    heard.counters["camera-1"] = ({}, {"wrong_type": 90})
    heard.fields["camera-1"] = {"state": "starting", "reason": FAULT}
    found = heard.found("frames")
    assert (found.level, found.what) == ("problem", f"frames of camera-1 are rejected: {FAULT}")
    assert "depth_in_metres = True" in found.hint


def test_slow_source_is_reported_with_the_busiest_processes(heard: Heard) -> None:
    gauges = {"source_hz": 3.0, "source_wanted_hz": 15.0, "cpu_percent": 99.0}
    reason = "its source gives 3.0 of 15.0 Hz"
    heard.fields["camera-1"] = {"state": "degraded", "reason": reason, "gauges": gauges}
    heard.fields["detector-1"] = {"gauges": {"cpu_percent": 62.0}}
    found = heard.found("rate")
    assert found.what.startswith(f"camera-1: {reason}; processor: camera-1 99 %, detector-1 62 %")


@pytest.mark.parametrize(("behind_s", "where"), [(3600.0, "behind"), (-3600.0, "ahead of")])
def test_live_stamps_an_hour_off_are_reported(heard: Heard, behind_s: float, where: str) -> None:
    heard.fields["camera-1"] = {"gauges": {"stamps_behind_s": behind_s}}
    assert heard.found("clocks").what == f"stamps of camera-1 are 3600 s {where} its host"


def test_calibration_of_another_size_is_reported_by_its_principal_point(heard: Heard) -> None:
    calibrate(heard, cx=64.0)
    assert "the principal point 64, 24 is far" in heard.found("calibration").what


@pytest.mark.parametrize(("fx", "height"), [(20.0, "3.4"), (85.0, "0.8")])
def test_heights_that_cannot_be_are_reported(heard: Heard, fx: float, height: str) -> None:
    calibrate(heard, fx)
    heard.people = (standing(),)
    assert f"appear {height} m tall" in heard.found("calibration").what


def test_people_upside_down_are_reported(heard: Heard) -> None:
    calibrate(heard)
    heard.people = (standing(upright=False),)
    assert "upside down" in heard.found("mount").what


def test_people_who_stand_before_a_calibrated_camera_are_no_problem(heard: Heard) -> None:
    calibrate(heard)
    heard.people = (standing(),)
    assert {one.level for one in heard.diagnostics()} == {"ok"}
