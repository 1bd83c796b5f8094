"""From messages to measurements."""

from collections import Counter

import numpy as np

from common.geometry import LINK_FROM_OPTICAL, rotation_from_rpy, transform_from
from common.messages import Detection, Detections
from services.tracker.observe import observe, rotated

BOX = np.array([0.0, 0.0, 10.0, 20.0], np.float32)


def detections(*people: Detection) -> Detections:
    return Detections(
        stamp_ns=1,
        sequence=0,
        camera="front",
        frame_id="front_optical_frame",
        model="fixed",
        width=640,
        height=480,
        people=people,
    )


def test_covariances_turn_with_the_camera() -> None:
    # Optical z is the map's x, optical x its -y, optical y its -z.
    sure = Detection(
        box_xyxy_px=BOX,
        score=0.9,
        position_m=np.array([0.0, 0.0, 2.0]),
        position_covariance_m2=np.diag([1.0, 2.0, 3.0]),
    )
    unsure = Detection(box_xyxy_px=BOX, score=0.9, position_m=np.array([0.0, 0.0, 2.0]))
    found = observe(detections(sure, unsure), None, LINK_FROM_OPTICAL, 100.0, Counter())
    first, second = (m.covariance_m2 for m in found.measurements)
    assert first is not None
    np.testing.assert_allclose(first, np.diag([3.0, 1.0, 2.0]))
    assert second is None


def test_turning_keeps_the_size_of_a_covariance() -> None:
    rotation = rotation_from_rpy(0.3, -0.2, 1.1)
    turned = rotated(np.diag([1.0, 2.0, 3.0]), transform_from([5.0, 6.0, 7.0], rotation))
    assert turned is not None
    assert (turned == turned.T).all()
    np.testing.assert_allclose(np.linalg.eigvalsh(turned), [1.0, 2.0, 3.0])
