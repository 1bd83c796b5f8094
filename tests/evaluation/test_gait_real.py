"""people4d gait on real depth: points lie on the bodies that a real camera saw."""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from common.geometry.transforms import apply, invert, project
from evaluation.gait.following import follow
from evaluation.gait.report import read_wish
from people4d.messages import CameraInfo
from services.gait.people import Found, Scene

AROUND_PX = 4
SAME_M = 0.10
FRAME_S = 1.5  # for detector, tracker and points; a tenth of it on an idle machine

Box = tuple[float, float, float, float]
Watched = list[tuple[CameraInfo, Scene, Sequence[Found]]]


def watched(source: Path, box: Box | None, *settings: str) -> Watched:
    seen: Watched = []

    def watch(info: CameraInfo, scene: Scene, found: Sequence[Found]) -> None:
        seen.append((info, scene, found))

    begin_s = time.process_time()
    frames = len(list(follow(read_wish(str(source), box, "", settings), watch)))
    assert time.process_time() - begin_s < 5.0 + FRAME_S * frames
    return seen


def off_m(info: CameraInfo, scene: Scene, found: Found) -> list[float]:
    """Return how far measured points are from the depth that the camera saw about their pixels."""
    points = [point for point in found.person.points if point.state == "measured"]
    if not points:
        return []
    places = apply(invert(scene.fixed_from_optical), np.array([p.position_m for p in points]))
    errors = []
    for place, pixel in zip(places, project(places, info), strict=True):
        u, v = np.rint(pixel).astype(int)
        rows, columns = (slice(max(x - AROUND_PX, 0), x + AROUND_PX + 1) for x in (v, u))
        depth_m = scene.depth_mm[rows, columns] / 1000.0
        known = depth_m[depth_m > 0]
        errors.append(float(np.abs(known - place[2]).min()) if known.size else np.inf)
    return errors


def test_people_who_cross_before_an_xtion(shared: Path) -> None:
    # From frame 26 on somebody comes in and walks away from the camera.
    settings = ("camera.options.fps=10", "camera.start_s=2.6", "camera.max_frames=14")
    seen = watched(shared / "data" / "rgbd" / "filinha", None, *settings)
    errors = [
        off for info, scene, found in seen for one in found for off in off_m(info, scene, one)
    ]
    with_points = [found for _, _, found in seen if any(one.person.points for one in found)]
    assert len(with_points) >= 6
    assert len(errors) >= 12
    assert np.mean(np.array(errors) <= SAME_M) >= 0.95
    assert all(one.person.measures.step_length_m is None for _, _, f in seen for one in f)


def test_somebody_who_stands_before_a_robot(shared: Path) -> None:
    """One frame of a ROS bag: who is followed is told by a box, as in the thesis."""
    bag = shared / "data" / "rgbd" / "tue" / "2019-05-03-12-41-38.bag"
    ((info, scene, (found,)),) = watched(bag, (236.0, 60.0, 377.0, 479.0))
    points = {point.name: point for point in found.person.points}
    # The camera's height and tilt are not told: it stands at the origin and looks along x. The
    # picture ends at the shins, so that no feet are to be told.
    assert "head" in points
    assert not {"left_foot", "right_foot"} & points.keys()
    assert points["head"].position_m[0] == pytest.approx(2.0, abs=0.2)
    assert max(off_m(info, scene, found)) <= SAME_M
    # By eye the right hand holds a telephone 105 rows under the middle of the head, 1.95 m away, at
    # a focal length of about 550: 0.37 m lower.
    below_m = points["head"].position_m[2] - points["right_hand"].position_m[2]
    assert below_m == pytest.approx(0.37, abs=0.1)
