"""people4d gait on recordings of real depth cameras: points lie on the bodies."""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from common.geometry.transforms import apply, invert, project
from evaluation.gait.report import read_run
from evaluation.gait.run import estimate_gait
from people4d.messages import CameraInfo
from services.gait.estimator import GaitFrame, GaitResult

AROUND_PX = 4
SAME_M = 0.10
FRAME_S = 1.5  # limit for detector, tracker and points; an idle machine needs a tenth of it

Box = tuple[float, float, float, float]
Results = list[tuple[CameraInfo, GaitFrame, Sequence[GaitResult]]]


def results_of(source: Path, box: Box | None, *settings: str) -> Results:
    found: Results = []

    def on_frame(info: CameraInfo, frame: GaitFrame, results: Sequence[GaitResult]) -> None:
        found.append((info, frame, results))

    begin_s = time.process_time()
    frames = len(list(estimate_gait(read_run(str(source), box, "", settings), on_frame)))
    assert time.process_time() - begin_s < 5.0 + FRAME_S * frames
    return found


def off_m(info: CameraInfo, frame: GaitFrame, result: GaitResult) -> list[float]:
    """Return the distances of measured points from the depth about their pixels."""
    points = [point for point in result.person.points if point.state == "measured"]
    if not points:
        return []
    positions = apply(invert(frame.fixed_from_optical), np.array([p.position_m for p in points]))
    errors = []
    for position, pixel in zip(positions, project(positions, info), strict=True):
        u, v = np.rint(pixel).astype(int)
        rows, columns = (slice(max(x - AROUND_PX, 0), x + AROUND_PX + 1) for x in (v, u))
        depth_m = frame.depth_mm[rows, columns] / 1000.0
        known = depth_m[depth_m > 0]
        errors.append(float(np.abs(known - position[2]).min()) if known.size else np.inf)
    return errors


@pytest.mark.slow
def test_people_who_cross_before_an_xtion(shared: Path) -> None:
    # A person enters at frame 26 and walks away from the camera.
    settings = ("camera.options.fps=10", "camera.start_s=2.6", "camera.max_frames=14")
    found = results_of(shared / "data" / "rgbd" / "filinha", None, *settings)
    errors = [
        off for info, frame, people in found for one in people for off in off_m(info, frame, one)
    ]
    with_points = [people for *_, people in found if any(one.person.points for one in people)]
    assert len(with_points) >= 6
    assert len(errors) >= 12
    assert np.mean(np.array(errors) <= SAME_M) >= 0.95
    assert all(one.person.measures.step_length_m is None for *_, people in found for one in people)


def test_person_standing_before_a_robot_by_box(shared: Path) -> None:
    """One frame of a ROS bag, with a box as published."""
    bag = shared / "data" / "rgbd" / "tue" / "2019-05-03-12-41-38.bag"
    ((info, frame, (result,)),) = results_of(bag, (236.0, 60.0, 377.0, 479.0))
    points = {point.name: point for point in result.person.points}
    # The camera's pose is not known: it is at the origin and looks along x. The image ends at the
    # shins, so that there are no feet.
    assert "head" in points
    assert not {"left_foot", "right_foot"} & points.keys()
    assert points["head"].position_m[0] == pytest.approx(2.0, abs=0.2)
    assert max(off_m(info, frame, result)) <= SAME_M
    # In the image the right hand holds a telephone 105 rows below the middle of the head, 1.95 m
    # away, at a focal length of about 550 px: 0.37 m lower.
    below_m = points["head"].position_m[2] - points["right_hand"].position_m[2]
    assert below_m == pytest.approx(0.37, abs=0.1)
