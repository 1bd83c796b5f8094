"""Errors of position, velocity and orientation worked on paper (docs/method.md, section 9)."""

import math

import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL, rotation_from_rpy, transform_from
from common.metrics.pose import PoseErrors
from common.metrics.record import EvaluationFrame, EvaluationSequence, GroundTruth, Hypotheses
from common.metrics.scores import Scores, score
from common.metrics.similarity import GroundDistance
from people4d.messages import F64

PI = math.pi


def pair(
    position_m: tuple[float, float] = (0, 0),
    velocity_mps: tuple[float, float] = (0, 0),
    yaws_rad: tuple[float, float] = (0, 0),
    map_from_camera: F64 | None = None,
) -> EvaluationFrame:
    """Make a frame with one person at rest in the origin, and one track with these errors."""
    return EvaluationFrame(
        stamp_ns=0,
        truth=GroundTruth(
            ids=("A",),
            positions_m=np.zeros((1, 3)),
            velocities_mps=np.zeros((1, 3)),
            yaws_rad=np.array(yaws_rad[:1]),
        ),
        hypotheses=Hypotheses(
            ids=(1,),
            positions_m=np.array([[*position_m, 0.7]]),
            velocities_mps=np.array([[*velocity_mps, 0.9]]),
            yaws_rad=np.array(yaws_rad[1:]),
        ),
        map_from_camera=map_from_camera,
    )


def scores(*frames: EvaluationFrame) -> Scores:
    """Score frames one after the other, 1 s apart."""
    later = (
        EvaluationFrame(
            stamp_ns=i * 10**9,
            truth=frame.truth,
            hypotheses=frame.hypotheses,
            map_from_camera=frame.map_from_camera,
        )
        for i, frame in enumerate(frames)
    )
    return score(EvaluationSequence("hand-made", tuple(later)), GroundDistance(1.0))


def errors(*frames: EvaluationFrame) -> PoseErrors:
    return scores(*frames).pose


def test_rmse_of_each_axis() -> None:
    # x errors 0.3 and -0.4: sqrt((0.09 + 0.16) / 2) = 0.353553; y errors 0 and 0.2: 0.141421.
    row = errors(
        pair(position_m=(0.3, 0), velocity_mps=(0, 0.3)),
        pair(position_m=(-0.4, 0.2), velocity_mps=(0.2, -0.4)),
    ).row()
    assert row["position_rmse_x_m"] == pytest.approx(0.353553, abs=1e-6)
    assert row["position_rmse_y_m"] == pytest.approx(0.141421, abs=1e-6)
    assert row["velocity_rmse_x_mps"] == pytest.approx(0.141421, abs=1e-6)
    assert row["velocity_rmse_y_mps"] == pytest.approx(0.353553, abs=1e-6)


def test_along_and_across_the_axis_of_the_camera() -> None:
    # The camera looks to +y and 30 degrees down: errors (0.1, 0.2) are 0.2 along its axis and
    # -0.1 across, since its left is -x.
    turned = transform_from((5, 5, 2), rotation_from_rpy(0, math.radians(30), PI / 2))
    frame = pair((0.1, 0.2), (0.3, -0.4), map_from_camera=turned @ LINK_FROM_OPTICAL)
    pose = errors(frame)
    assert pose.along_across(pose.position_m) == pytest.approx(np.array([[0.2, -0.1]]))
    row = pose.row()
    assert row["position_rmse_along_m"] == pytest.approx(0.2)
    assert row["position_rmse_across_m"] == pytest.approx(0.1)
    assert row["velocity_rmse_along_mps"] == pytest.approx(0.4)
    assert row["velocity_rmse_across_mps"] == pytest.approx(0.3)


@pytest.mark.parametrize("camera", [None, transform_from((0, 0, 3), np.diag([1.0, -1.0, -1.0]))])
def test_a_camera_unknown_or_looking_straight_down_has_no_axis(camera: F64 | None) -> None:
    row = errors(pair((0.1, 0.2), map_from_camera=camera)).row()
    assert row["position_rmse_along_m"] is None
    assert row["position_rmse_x_m"] == pytest.approx(0.1)


def test_orientation_error_wraps() -> None:
    # pi - 0.1 and -pi + 0.1 are 0.2 apart, not 2 pi - 0.2; half a turn is half a turn both ways.
    assert errors(pair(yaws_rad=(PI - 0.1, -PI + 0.1))).yaw_error_rad == pytest.approx([0.2])
    assert errors(pair(yaws_rad=(-PI + 0.1, PI - 0.1))).yaw_error_rad == pytest.approx([0.2])
    assert errors(pair(yaws_rad=(PI, -PI))).yaw_error_rad == pytest.approx([0.0])
    assert errors(pair(yaws_rad=(-PI / 2, PI / 2))).yaw_error_rad == pytest.approx([PI])
    # Errors of 30 and 40 degrees: sqrt((900 + 1600) / 2) = 35.355 degrees.
    tracked = errors(pair(yaws_rad=(3.0, 3.0 + PI / 6)), pair(yaws_rad=(-3.0, -3.0 - PI / 4.5)))
    assert tracked.row()["yaw_rmse_deg"] == pytest.approx(35.355, abs=1e-3)


def test_circular_correlation() -> None:
    assert errors(pair(yaws_rad=(2, 2))).yaw_correlation() == pytest.approx(1.0)
    assert errors(pair(yaws_rad=(2, 2 - PI))).yaw_correlation() == pytest.approx(-1.0)
    # Errors of 60 and 90 degrees: (0.5 + 0) / 2.
    sixty, ninety = pair(yaws_rad=(3, 3 + PI / 3)), pair(yaws_rad=(0, -PI / 2))
    assert errors(sixty, ninety).yaw_correlation() == pytest.approx(0.25)


def test_circular_correlation_as_the_book_writes_it() -> None:
    random = np.random.default_rng(1)
    a, b = random.uniform(-PI, PI, (2, 20))
    above = np.sum(np.sin(a) * np.sin(b) + np.cos(a) * np.cos(b))
    below = np.sum(np.sin(a) ** 2 + np.cos(a) ** 2) * np.sum(np.sin(b) ** 2 + np.cos(b) ** 2)
    pose = errors(*(pair(yaws_rad=(x, y)) for x, y in zip(a, b, strict=True)))
    assert pose.yaw_correlation() == pytest.approx(above / math.sqrt(below))


def test_success_rates() -> None:
    # Distances 0.1 and (0.3, 0.4) -> 0.5 m; velocities 0.2 and 0.6 m/s; yaw 20 and 60 degrees.
    row = errors(
        pair((0.1, 0), (0, 0.2), (0, math.radians(20))),
        pair((0.3, 0.4), (0.6, 0), (0, math.radians(-60))),
    ).row()
    position = [row[f"position_within_{limit}_m"] for limit in (0.15, 0.3, 0.5)]
    assert position == [0.5, 0.5, 1.0]
    velocity = [row[f"velocity_within_{limit}_mps"] for limit in (0.15, 0.3, 0.5)]
    assert velocity == [0.0, 0.5, 0.5]
    assert [row[f"yaw_within_{limit}_deg"] for limit in (30, 45, 90)] == [0.5, 0.5, 1.0]


def test_what_is_unknown_is_left_out_and_said() -> None:
    nan = math.nan
    row = errors(pair((0.2, 0), (nan, nan), (1, nan)), pair((0.2, 0), (0.1, 0), (1, 1))).row()
    assert row["poses"] == 2
    assert row["velocity_rmse_x_mps"] == pytest.approx(0.1)
    assert row["yaw_rmse_deg"] == pytest.approx(0.0)
    assert row["yaw_reported"] == 0.5


def test_no_match_has_no_errors() -> None:
    row = errors(pair(position_m=(3, 0))).row()
    assert row.pop("poses") == 0
    assert set(row.values()) == {None}


def test_measured_predicted_and_occluded_apart() -> None:
    def frame(x_m: float, predicted: bool, occluded: bool, out: bool = False) -> EvaluationFrame:
        return EvaluationFrame(
            stamp_ns=0,
            truth=GroundTruth(
                ids=("A",),
                positions_m=np.zeros((1, 3)),
                occluded=np.array([occluded]),
                out_of_view=np.array([out]),
            ),
            hypotheses=Hypotheses(
                ids=(1,), positions_m=np.array([[x_m, 0, 0]]), predicted=np.array([predicted])
            ),
        )

    result = scores(
        frame(0.1, predicted=False, occluded=False),
        frame(0.2, predicted=True, occluded=False),
        frame(0.4, predicted=True, occluded=True),
        frame(0.8, predicted=True, occluded=False, out=True),
    )
    assert result.pose_parts["measured"].position_m[:, 0].tolist() == [0.1]
    assert result.pose_parts["predicted"].position_m[:, 0].tolist() == [0.2]
    assert result.pose_parts["occluded"].position_m[:, 0].tolist() == [0.4]
    assert result.pose.position_m[:, 0].tolist() == [0.1, 0.2]
    assert result.lifetimes.coverage == 1.0
    assert result.lifetimes.coverage_measured == 0.5
