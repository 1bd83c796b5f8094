"""Scores against annotations, on a worked miniature."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.lib.marks.scores import MarkScores, MarkTruth, TrackedPerson, figures
from evaluation.annotations.marks import Mark, MarkView
from services.camera.config import CameraConfig
from tests import builders


def truth(person: str, u_px: float) -> MarkTruth:
    """Return a mark without depth and yaw."""
    return MarkTruth(Mark(person, u_px, 100.0, None), None, None)


def tracked(number: int, u_px: float, predicted: bool = False) -> TrackedPerson:
    """Return a track whose box is centred on a column."""
    return TrackedPerson(number, np.array([u_px - 20, 50.0, u_px + 20, 190.0]), predicted)


MARKS = {frame: (truth("A", 100.0), truth("B", 300.0)) for frame in range(6)}


def test_swapped_tracks_are_right_in_the_longer_part_only() -> None:
    """Two tracks swap after four of six frames: 8 of 12 right, 2 changes, 2 taken over."""
    tracks = {
        frame: [tracked(1, 100.0), tracked(2, 300.0)]
        if frame < 4
        else [tracked(2, 100.0), tracked(1, 300.0)]
        for frame in range(6)
    }
    scores = MarkScores(MARKS, tracks, rate_hz=10.0)
    result = figures(scores.outcomes)
    assert (result.found.part, result.owned.part) == (12, 8)
    assert (scores.id_switches, scores.takeovers) == (2, 2)
    assert scores.row()["idf1"] == pytest.approx(8 / 12)
    assert scores.within({0, 1}).row()["idf1"] == 1.0


def test_tracks_on_no_mark_are_false_alarms() -> None:
    """One of two people is tracked, and a track is off all marks: MOTA = 1 - (6 + 6) / 12."""
    tracks = {frame: [tracked(1, 100.0), tracked(2, 560.0, predicted=True)] for frame in range(6)}
    row = MarkScores(MARKS, tracks, rate_hz=10.0).row()
    assert (row["recall"], row["false_alarms"], row["mota"]) == (0.5, 6, 0.0)


def test_detected_track_comes_before_a_predicted_one_that_is_nearer() -> None:
    """Both boxes hold the mark; the predicted one is centred on it."""
    tracks = {0: [tracked(1, 100.0, predicted=True), tracked(2, 110.0)]}
    outcome = MarkScores({0: (truth("A", 100.0),)}, tracks, rate_hz=10.0).outcomes[0]
    assert outcome.track is not None
    assert outcome.track.id == 2


def at_position(track: TrackedPerson, x_m: float) -> TrackedPerson:
    """Return a track with a position on the x axis."""
    return replace(track, position_m=np.array([x_m, 0.0, 1.0]))


def test_box_with_two_marks_matches_the_mark_at_its_position() -> None:
    """A at 1 m hides B at 2 m; both boxes hold both marks, and B's is centred on A's mark."""
    marks = [
        replace(truth(person, u_px), point_m=np.array([x_m, 0.0, 1.2]))
        for person, u_px, x_m in (("A", 100.0, 1.0), ("B", 105.0, 2.0))
    ]
    tracks = [at_position(tracked(1, 105.0), 1.1), at_position(tracked(2, 100.0), 2.1)]
    outcomes = MarkScores({0: marks}, {0: tracks}, rate_hz=10.0).outcomes
    assert [o.track and o.track.id for o in outcomes] == [1, 2]
    boxes_only = [replace(t, position_m=None, detected_m=t.position_m) for t in tracks]
    outcomes = MarkScores({0: marks}, {0: boxes_only}, rate_hz=10.0).outcomes
    assert [o.track and o.track.id for o in outcomes] == [1, 2]
    unknown = [replace(t, position_m=None) for t in tracks]
    outcomes = MarkScores({0: marks}, {0: unknown}, rate_hz=10.0).outcomes
    assert [o.track and o.track.id for o in outcomes] == [2, 1]


@pytest.mark.parametrize(("x_m", "is_found"), [(1.4, True), (1.6, False)])
def test_track_of_a_head_is_on_the_mark_of_the_torso_below(x_m: float, is_found: bool) -> None:
    """The box ends above the mark; the position is 0.4 or 0.6 m from the surface there."""
    mark = replace(truth("A", 100.0), point_m=np.array([1.0, 0.0, 1.2]))
    head = replace(
        at_position(tracked(1, 100.0), x_m), box_xyxy_px=np.array([80.0, 20.0, 120.0, 60.0])
    )
    outcome = MarkScores({0: (mark,)}, {0: [head]}, rate_hz=10.0).outcomes[0]
    assert (outcome.track is not None) == is_found


@pytest.mark.parametrize(("yaw_deg", "expected_rad"), [(0, 0.0), (90, math.pi / 2), (180, math.pi)])
def test_facing_is_measured_from_the_viewing_ray_to_the_left(
    yaw_deg: float, expected_rad: float
) -> None:
    """A level camera at the origin looks along +x: away is yaw 0, to the image's left +y."""
    info = builders.camera_info(fx=500.0)
    view = MarkView(info, CameraConfig(source="x").mount_from_optical)
    assert view.yaw_rad(Mark("A", 320.0, 240.0, yaw_deg)) == pytest.approx(expected_rad)
    depth_mm = np.full((480, 640), 2000, np.uint16)
    point_m = view.point_m(Mark("A", 320.0, 240.0, yaw_deg), depth_mm)
    assert point_m == pytest.approx([2.0, 0.0, 0.0])


@pytest.mark.parametrize(("edge_px", "is_known"), [(323, False), (328, True)])
def test_no_point_at_an_edge_of_depth(edge_px: int, is_known: bool) -> None:
    """A surface 1 m behind begins 3 px, or 8 px, to the right of the mark."""
    info = builders.camera_info(fx=500.0)
    view = MarkView(info, CameraConfig(source="x").mount_from_optical)
    depth_mm = np.full((480, 640), 2000, np.uint16)
    depth_mm[:, edge_px:] = 3000
    assert (view.point_m(Mark("A", 320.0, 240.0, None), depth_mm) is not None) == is_known
