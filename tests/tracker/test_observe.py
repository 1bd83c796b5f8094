"""From messages to measurements."""

from collections import Counter

import numpy as np
import pytest

from common.geometry.transform_history import TransformEstimate
from common.geometry.transforms import (
    LINK_FROM_OPTICAL,
    rotation_from_rpy,
    transform_from,
)
from people4d.messages import Detection, Detections
from services.tracker.cameras.frame_join import PendingFrame
from services.tracker.cameras.poses import CameraPoseLookup, pose_covariance
from services.tracker.observe import (
    PEOPLE_MAX,
    FrameObserver,
    observe,
    rotated,
)
from tests import builders

BOX = np.array([0.0, 0.0, 10.0, 20.0], np.float32)


def detections(*people: Detection) -> Detections:
    return builders.detections(*people, stamp_ns=1)


def test_covariances_turn_with_the_camera() -> None:
    # Optical z is the map's x, optical x its -y, optical y its -z.
    certain = Detection(
        box_xyxy_px=BOX,
        score=0.9,
        position_m=np.array([0.0, 0.0, 2.0]),
        position_covariance_m2=np.diag([1.0, 2.0, 3.0]),
    )
    uncertain = Detection(box_xyxy_px=BOX, score=0.9, position_m=np.array([0.0, 0.0, 2.0]))
    found = observe(
        detections(certain, uncertain), None, TransformEstimate(LINK_FROM_OPTICAL), Counter()
    )
    first, second = (m.covariance_m2 for m in found.measurements)
    assert first is not None
    np.testing.assert_allclose(first, np.diag([3.0, 1.0, 2.0]))
    assert second is None


@pytest.mark.parametrize(
    ("probability", "expected"),
    [(None, 0.0), (0.5, 0.0), (0.9, 2.197225), (0.0, -6.906755), (1.0, 6.906755)],
)
def test_probability_of_a_person_is_log_odds(probability: float | None, expected: float) -> None:
    # ln 9 = 2.197225; limited to ln 999 = 6.906755; without a probability nothing is known.
    position_m = np.array([0.0, 0.0, 2.0])
    someone = Detection(box_xyxy_px=BOX, score=0.9, person=probability, position_m=position_m)
    found = observe(detections(someone), None, TransformEstimate(LINK_FROM_OPTICAL), Counter())
    assert found.measurements[0].person_log_odds == pytest.approx(expected, abs=1e-6)


def test_turning_keeps_the_size_of_a_covariance() -> None:
    rotation = rotation_from_rpy(0.3, -0.2, 1.1)
    turned = rotated(np.diag([1.0, 2.0, 3.0]), transform_from([5.0, 6.0, 7.0], rotation))
    assert turned is not None
    assert (turned == turned.T).all()
    np.testing.assert_allclose(np.linalg.eigvalsh(turned), [1.0, 2.0, 3.0])


def test_extrapolated_base_adds_covariance_to_positions() -> None:
    # The camera looks along x, the person is 4 m in front of it: a turn by 0.05 rad moves the
    # person 0.2 m along y, in addition to 0.1 m of the base in each direction.
    matrix = pose_covariance(
        np.array([4.0, 0.0, 0.0]), TransformEstimate(LINK_FROM_OPTICAL, 0.1, 0.05)
    )
    np.testing.assert_allclose(matrix, np.diag([0.01, 0.01 + 0.04, 0.0]), atol=1e-12)


def test_covariance_is_added_above_a_pose_sigma() -> None:
    person = Detection(box_xyxy_px=BOX, score=0.9, position_m=np.array([0.0, 0.0, 2.0]))
    for sigma_m, is_doubted in ((0.0, False), (0.005, False), (0.05, True)):
        position = TransformEstimate(LINK_FROM_OPTICAL, sigma_m, 0.0)
        (found,) = observe(detections(person), None, position, Counter()).measurements
        assert (found.added_covariance_m2 is not None) == is_doubted


def test_of_too_many_people_those_of_the_highest_scores_are_tracked() -> None:
    people = [
        Detection(box_xyxy_px=BOX, score=number / 500, position_m=np.array([0.0, 0.0, 2.0]))
        for number in range(500)
    ]
    counters = Counter[str]()
    pose = TransformEstimate(LINK_FROM_OPTICAL)
    found = observe(detections(*people), None, pose, counters)
    assert {m.index for m in found.measurements} == set(range(500 - PEOPLE_MAX, 500))
    assert counters["too_many"] == 500 - PEOPLE_MAX


def test_frame_without_embeddings_has_the_embedder_of_the_last_ones() -> None:
    observer = FrameObserver(CameraPoseLookup("map", required=False), Counter())
    frame = detections()
    embeddings = builders.embeddings(frame, (), model="osnet")
    frames = [PendingFrame(frame, 1, 1, one) for one in (None, embeddings, None)]
    found = [observer.observe(one) for one in frames]
    assert [one.embedder for one in found if one] == ["", "osnet", "osnet"]


def test_bearing_leads_from_the_camera_to_the_person() -> None:
    # The camera looks along +x from the origin; the person is 45 deg to the right.
    person = Detection(box_xyxy_px=BOX, score=0.9, position_m=np.array([2.0, 0.0, 2.0]))
    pose = TransformEstimate(LINK_FROM_OPTICAL)
    (found,) = observe(detections(person), None, pose, Counter()).measurements
    assert found.bearing_rad == pytest.approx(np.radians(-45))
