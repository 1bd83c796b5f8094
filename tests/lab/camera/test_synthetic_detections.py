"""Synthetic detections: visibility by geometry, and errors at given rates."""

import math

import msgspec
import numpy as np
import pytest

from common.geometry.transforms import (
    LINK_FROM_OPTICAL,
    apply,
    invert,
    rotation_from_rpy,
    transform_from,
)
from lab.camera import synthetic_detections
from lab.camera.synthetic_detections import (
    CONFIDENCE_SIGMA,
    SCORE_SIGMA,
    SyntheticDetections,
    SyntheticDetectionsConfig,
)
from lab.depth.config import DepthSensorModel
from lab.truth.silhouette import silhouettes
from people4d.messages import F64, Detection
from tests import builders

# Detects all visible people at their true positions.
FAULTLESS = SyntheticDetectionsConfig(
    keypoint_share=0,
    keypoint_least_px=0,
    box_share=0,
    recall=1,
    false_alarms=0,
    front_m=0,
    side_m=0,
    no_position=0,
    heading_rad=0,
    reversals=0,
    sensor=DepthSensorModel(noise_px=0),
)

INFO = builders.camera_info(fx=615.0, cx=319.5, cy=239.5)
OPTICAL_FROM_MAP = invert(transform_from((0, 0, 1.15), np.eye(3)) @ LINK_FROM_OPTICAL)
NOSE, LEFT_EAR, RIGHT_EAR = 0, 3, 4

# x forward, y left, z up of a standing person, left side first; torso's middle at x = y = 0.
PERSON: F64 = np.array(
    [
        [0.10, 0, 1.58],
        [0.08, 0.03, 1.61],
        [0.08, -0.03, 1.61],
        [0.0, 0.075, 1.60],
        [0.0, -0.075, 1.60],
        [0, 0.18, 1.40],
        [0, -0.18, 1.40],
        [0, 0.24, 1.12],
        [0, -0.24, 1.12],
        [0.05, 0.26, 0.87],
        [0.05, -0.26, 0.87],
        [0, 0.10, 0.92],
        [0, -0.10, 0.92],
        [0, 0.10, 0.50],
        [0, -0.10, 0.50],
        [0, 0.10, 0.09],
        [0, -0.10, 0.09],
    ]
)


def person(x_m: float, y_m: float, yaw_deg: float = 180.0) -> F64:
    turn = rotation_from_rpy(0, 0, math.radians(yaw_deg))
    return apply(transform_from((x_m, y_m, 0), turn), PERSON)


def in_view(
    people: list[F64], config: SyntheticDetectionsConfig = FAULTLESS, frame: int = 0
) -> list[Detection]:
    return list(
        SyntheticDetections(config, INFO, 3)
        .at(people, OPTICAL_FROM_MAP, frame * 33_333_333)
        .detections
    )


def test_faultless_detection_of_one_person() -> None:
    (found,) = in_view([person(4.0, 0.0)])
    # Torso: mean height (1.40 + 0.92) / 2 = 1.16 m, camera at 1.15 m: 0.01 m above the axis.
    assert found.position_m == pytest.approx([0, -0.01, 4.0])
    assert found.keypoints is not None
    # Left shoulder: the person faces the camera, so their left (0.18 m) is on the image's right:
    # u = 319.5 + 615 * 0.18 / 4 = 347.2, v = 239.5 - 615 * (1.40 - 1.15) / 4 = 201.1.
    assert found.keypoints[5, :2] == pytest.approx([347.175, 201.0625], abs=1e-3)
    assert found.keypoints[5, 2] == pytest.approx(0.92, abs=4 * CONFIDENCE_SIGMA)
    # Crown 0.14 m above the ears: v = 239.5 - 615 * 0.59 / 4 = 148.8.
    # Soles 0.13 m below the ankles: v = 239.5 + 615 * 1.19 / 4 = 422.5.
    assert found.box_xyxy_px[[1, 3]] == pytest.approx([148.8, 422.5], abs=0.1)
    assert found.score == pytest.approx(0.9, abs=4 * SCORE_SIGMA)


def test_position_lies_on_the_surface_that_faces_the_camera() -> None:
    config = msgspec.structs.replace(FAULTLESS, front_m=0.12, side_m=0.17)
    for yaw_deg, thick_m in ((180, 0.12), (0, 0.12), (90, 0.17)):
        (found,) = in_view([person(4.0, 0.0, yaw_deg)], config)
        assert found.position_m == pytest.approx([0, -0.01, 4.0 - thick_m], abs=1e-3)


@pytest.mark.slow
def test_heading_of_the_chest() -> None:
    # Optical frame: x right, y down, z forward. Facing the camera: -z; image-left (+90 deg): -x.
    for yaw_deg, heading in ((180, [0, 0, -1]), (0, [0, 0, 1]), (120, [-0.8660254, 0, -0.5])):
        (found,) = in_view([person(4.0, 0.0, yaw_deg)])
        assert found.heading == pytest.approx(heading, abs=1e-6)
    config = SyntheticDetectionsConfig(false_alarms=0, recall=1, heading_rad=0.2, reversals=0.1)
    detections = SyntheticDetections(config, INFO, 5)
    errors = []
    for k in range(1500):
        (found,) = detections.at([person(4.0, 0.0)], OPTICAL_FROM_MAP, k * 300_000_000).detections
        assert found.heading is not None
        assert found.heading_sigma_rad == 0.2
        errors.append(math.atan2(found.heading[0], -found.heading[2]))
    turned = np.abs(errors) > math.pi / 2
    # 1500 at 0.1: standard deviation 0.0077; 0.2 rad over 1350: 0.004.
    assert turned.mean() == pytest.approx(0.1, abs=0.03)
    assert np.array(errors)[~turned].std() == pytest.approx(0.2, abs=0.016)


def test_far_ear_is_hidden_by_the_head() -> None:
    ahead = silhouettes(
        [person(4, 0, 180), person(4, 1, 0), person(4, -1, 90)], OPTICAL_FROM_MAP, INFO
    )
    assert ahead[0].visible[:5].all()
    assert ahead[1].visible[:5].tolist() == [False, False, False, True, True]  # from behind
    # Facing image-left (yaw +90 deg): the person's left ear points away from the camera (-x is
    # towards it; left of +y is -x): the left ear is near, the right ear far.
    assert ahead[2].visible[[LEFT_EAR, RIGHT_EAR]].tolist() == [True, False]


def test_person_behind_another_is_occluded() -> None:
    front, behind = person(2.5, 0.0), person(4.0, 0.0)
    ahead = silhouettes([behind, front], OPTICAL_FROM_MAP, INFO)
    assert ahead[1].visible_share > 0.7  # the feet are below the image
    # Behind, at 2.5 / 4 of the size: all of the torso is hidden by the other torso.
    assert not ahead[0].visible[[5, 6, 11, 12]].any()
    assert ahead[0].visible_share < 0.4
    beside = silhouettes([person(4.0, 1.0), front], OPTICAL_FROM_MAP, INFO)
    assert beside[0].visible_share == 1


def test_hidden_people_are_not_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(synthetic_detections, "SHARE_NONE", 0.4)
    monkeypatch.setattr(synthetic_detections, "SHARE_FULL", 0.6)
    front = person(2.5, 0.0)
    assert len(in_view([person(4.0, 0.0), front])) == 1
    assert len(in_view([person(4.0, 1.0), front])) == 2
    assert len(in_view([person(4.0, 0.0)])) == 1


def test_people_outside_of_the_image_are_not_detected() -> None:
    assert in_view([]) == []
    assert in_view([person(-3.0, 0.0), person(3.0, 4.0)]) == []
    (half,) = in_view([person(4.0, 2.0)])  # image border at 4 * 319.5 / 615 = 2.08 m
    assert half.box_xyxy_px[0] == 0
    (far,) = in_view([person(6.0, 0.0)])  # beyond the range of depth
    assert far.position_m is None


@pytest.mark.slow
def test_rates_are_as_configured() -> None:
    config = SyntheticDetectionsConfig(recall=0.9, false_alarms=0.2, no_position=0.1)
    source = SyntheticDetections(config, INFO, 11)
    people = [person(3.5, -1.0), person(4.5, 1.0, 30)]
    boxes = [box(p) for p in people]
    true, false, without = 0, 0, 0
    frames = 1000
    for k in range(frames):
        detections = source.at(people, OPTICAL_FROM_MAP, k * 100_000_000, k).detections
        for found in detections:
            is_true = min(np.abs(found.box_xyxy_px - b).max() for b in boxes) < 25
            true += is_true
            false += not is_true
            without += is_true and found.position_m is None
    # 2000 chances at 0.9 have a standard deviation of 13.4 if independent. They almost are: a miss
    # lasts 0.1 s, one frame here. 1000 Poisson numbers of mean 0.2: 14.
    assert true / (2 * frames) == pytest.approx(0.9, abs=0.03)
    assert false / frames == pytest.approx(0.2, abs=0.06)
    assert without / true == pytest.approx(0.1, abs=0.035)


def box(keypoints_m: F64) -> F64:
    return silhouettes([keypoints_m], OPTICAL_FROM_MAP, INFO)[0].box_xyxy_px


@pytest.mark.slow
def test_keypoint_noise_grows_with_the_person_and_lasts() -> None:
    config = SyntheticDetectionsConfig(recall=1, false_alarms=0)
    detections = SyntheticDetections(config, INFO, 5)
    errors = []
    there = person(3.0, 0.0)
    outline = silhouettes([there], OPTICAL_FROM_MAP, INFO)[0]
    for k in range(1500):
        found = detections.at([there], OPTICAL_FROM_MAP, k * 50_000_000).detections[0]
        assert found.keypoints is not None
        errors.append(found.keypoints[5:15, :2] - outline.keypoints_px[5:15])
    track = np.stack(errors)
    # The box reaches from the soles, 0.13 m below the ankles, to the crown, 0.14 m above the ears:
    # (1.60 + 0.14 - 0.09 + 0.13) m * 615 px / 3 m = 364.9 px. 0.009 of it: 3.3 px.
    height_px = outline.box_xyxy_px[3] - outline.box_xyxy_px[1]
    assert height_px == pytest.approx(364.9)
    assert track.std() == pytest.approx(0.009 * height_px, rel=0.1)
    # One knot of 0.15 s apart: 1 / pi, see noise.Persistence.
    assert np.mean(track[3:] * track[:-3]) / np.mean(track**2) == pytest.approx(
        1 / math.pi, abs=0.06
    )


@pytest.mark.slow
def test_depth_noise_follows_the_sensor() -> None:
    sensor = DepthSensorModel(noise_px=0.07)
    config = msgspec.structs.replace(FAULTLESS, sensor=sensor)
    detections = SyntheticDetections(config, INFO, 5)
    depths = []
    for k in range(1000):
        found = detections.at([person(4.0, 0.0)], OPTICAL_FROM_MAP, k * 300_000_000).detections[0]
        assert found.position_m is not None
        depths.append(found.position_m[2])
    # 4^2 * 0.07 / (385 * 0.05) = 58.2 mm, four readings: 29.1 mm.
    assert np.std(depths) == pytest.approx(0.0291, rel=0.1)
    assert np.mean(depths) == pytest.approx(4.0, abs=0.004)


def test_same_stamp_same_detections_in_any_order() -> None:
    people = [person(3.0, -0.8), person(4.0, 0.9, 45)]
    config = SyntheticDetectionsConfig(false_alarms=0.5)
    fresh = [
        SyntheticDetections(config, INFO, 3).at(people, OPTICAL_FROM_MAP, k * 40_000_000)
        for k in range(20)
    ]
    one = SyntheticDetections(config, INFO, 3)
    again = [one.at(people, OPTICAL_FROM_MAP, k * 40_000_000) for k in reversed(range(20))][::-1]
    assert list(map(repr, fresh)) == list(map(repr, again))
    other = SyntheticDetections(config, INFO, 4).at(people, OPTICAL_FROM_MAP, 0)
    assert repr(other) != repr(fresh[0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"recall": 1.5}, "recall: "),
        ({"false_alarms": -1}, "false_alarms: "),
        ({"front_m": -1}, "front_m: "),
    ],
)
def test_configuration_is_checked(change: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SyntheticDetectionsConfig(**change)  # type: ignore[arg-type]


def test_depths_of_keypoints_are_on_the_surface_if_asked_for() -> None:
    (without,) = in_view([person(4.0, 0.0)])
    assert without.keypoint_depths_m is None
    config = msgspec.structs.replace(FAULTLESS, keypoint_depths=True)
    (found,) = in_view([person(4.0, 0.0)], config)
    assert found.keypoint_depths_m is not None
    # Shoulders and hips 0.055 and 0.11 m behind the surface, knees 0.062 m.
    assert found.keypoint_depths_m[[5, 11, 13]] == pytest.approx([3.96, 3.89, 3.94], abs=0.06)
