"""First stage that loses an annotated step of a real person."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.lib.gait.causes import Scene, first_loss

DEPTH_M = 3.0
INFO = SimpleNamespace(fx=500.0)
LEFT, RIGHT = 15, 16  # ankles, COCO


def scene(state: str = "measured", yaw_rad: float = 0.0, **changed: Any) -> Scene:
    """Return three frames of person 7, walking along x, with ankles 0.3 m apart."""
    keypoints = np.zeros((17, 3), np.float32)
    keypoints[LEFT] = (200.0, 300.0, changed.get("confidence", 0.9))
    keypoints[RIGHT] = (200.0 + changed.get("apart_px", 50.0), 300.0, 0.9)
    depth_mm = np.full((480, 640), changed.get("depth_mm", 3000), np.uint16)
    run = []
    for index in range(3):
        observed = SimpleNamespace(id=7, keypoints=keypoints, depth_m=DEPTH_M, yaw_rad=yaw_rad)
        head = SimpleNamespace(
            name="head", state="measured", position_m=np.array((0.3 * index, 0.0, 1.7))
        )
        foot = SimpleNamespace(name="left_foot", state=state)
        result = SimpleNamespace(person=SimpleNamespace(id=7, points=(head, foot)))
        run.append((INFO, SimpleNamespace(depth_mm=depth_mm, observations=(observed,)), (result,)))
    return Scene(run, {(7, index): "N" for index in range(3)})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changed", "stage"),
    [
        ({}, "steps"),
        ({"confidence": 0.3}, "keypoint"),
        ({"apart_px": 10.0}, "one leg"),  # 0.06 m
        ({"depth_mm": 2000}, "depth"),
        ({"yaw_rad": np.pi / 2}, "heading"),
        ({"state": "predicted"}, "point"),
    ],
)
def test_first_stage_that_fails_is_the_cause(changed: dict[str, Any], stage: str) -> None:
    assert first_loss(scene(**changed), "N", 1.0, "left") == stage


def test_person_without_a_track_is_lost_by_the_track() -> None:
    assert first_loss(scene(), "G", 1.0, "left") == "track"
