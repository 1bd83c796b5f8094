"""Expected pixels of points by keypoints."""

import numpy as np
import pytest

from people4d.messages import F32
from services.gait.points.keypoints import KeypointTrust, find_anchors, torso_pixel

LEFT_ELBOW, LEFT_WRIST, LEFT_KNEE, LEFT_ANKLE = 7, 9, 13, 15


def keypoints(**at: tuple[float, float, float]) -> F32:
    """Keypoints k0 to k16; the others have no confidence."""
    found = np.zeros((17, 3), np.float32)
    for name, values in at.items():
        found[int(name[1:])] = values
    return found


def test_hand_is_beyond_the_wrist() -> None:
    # The forearm is 50 px long, downwards; 0.5 of it is 25 px.
    found = find_anchors(keypoints(k7=(100, 100, 0.9), k9=(100, 150, 0.8)))
    assert found["left_hand"].pixel == pytest.approx([100, 175])
    assert found["left_hand"].confidence == pytest.approx(0.8)
    assert set(found) == {"left_hand"}


def test_hand_without_elbow_is_at_the_wrist_with_larger_sigma() -> None:
    both = keypoints(k7=(100, 100, 0.9), k9=(100, 150, 0.8))
    wrist = keypoints(k7=(100, 100, 0.2), k9=(100, 150, 0.8))
    found = find_anchors(wrist)["left_hand"]
    assert found.pixel == pytest.approx([100, 150])
    assert found.sigma > find_anchors(both)["left_hand"].sigma


def test_doubtful_ankle_is_an_anchor_and_a_doubtful_wrist_is_none() -> None:
    found = find_anchors(keypoints(k9=(100, 150, 0.2), k15=(100, 300, 0.2), k16=(120, 300, 0.05)))
    assert set(found) == {"left_foot"}


def test_head_is_the_mean_of_the_visible_face() -> None:
    face = keypoints(k0=(50, 40, 0.9), k1=(54, 36, 0.6), k3=(200, 0, 0.1))  # nose, eye; no ear
    assert find_anchors(face)["head"].pixel == pytest.approx([52, 38])


@pytest.mark.parametrize("wrist", [(100, 150, 0.39), (np.nan, 150, 0.9), (100, 150, np.nan)])
def test_unconfident_or_nan_keypoint_gives_no_anchor(wrist: tuple[float, float, float]) -> None:
    assert find_anchors(keypoints(k9=wrist)) == {}


def test_no_keypoints_give_no_anchors() -> None:
    assert find_anchors(None) == {}
    assert find_anchors(np.zeros((5, 3), np.float32)) == {}
    assert torso_pixel(None) is None


def test_torso_pixel_needs_shoulders_and_hips() -> None:
    corners = {"k5": (90, 100), "k6": (110, 100), "k11": (92, 160), "k12": (108, 160)}
    estimate = keypoints(**{name: (*position, 0.9) for name, position in corners.items()})
    assert torso_pixel(estimate) == pytest.approx([100, 130])
    estimate[11, 2] = 0.3
    assert torso_pixel(estimate) is None


def test_trust_follows_the_mean_confidence_of_the_ankles() -> None:
    # Means of 0.8 and 0.0 are 0.8, 0.4 and 0.53; a frame without a detection changes nothing.
    trust, high, low = KeypointTrust(), keypoints(k15=(0, 0, 0.9), k16=(0, 0, 0.7)), keypoints()
    assert not trust.update(None)
    assert [trust.update(one) for one in (high, None, low, high)] == [True, True, False, True]
    for _ in range(1000):
        trust.update(high)
    assert [trust.update(low) for _ in range(40)].index(False) == 28  # 0.8 * 0.98**29 < 0.45
