"""Keypoints of detections, lifted to 3D by their depth."""

import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F64, CameraInfo, Detection

CONFIDENCE_MIN = 0.3  # minimum confidence of a lifted keypoint
REACH_M = 1.0  # maximum difference of a keypoint's depth from the person's [m]


def lift(person: Detection, info: CameraInfo) -> F64 | None:
    """Return the points of a person's visible surface at the keypoints.

    Args:
        person: The detection.
        info: Calibration of the camera.

    Returns:
        17x3 [m], optical frame; NaN where the keypoint is uncertain or has no depth of the person;
        None if the detection has no keypoints or no depth at them.
    """
    if person.keypoints is None or person.keypoint_depths_m is None:
        return None
    depth_m = person.keypoint_depths_m.astype(float)
    valid = (person.keypoints[:, 2] >= CONFIDENCE_MIN) & (depth_m > 0)
    if person.position_m is not None:
        valid &= np.abs(depth_m - person.position_m[2]) < REACH_M
    points = deproject(person.keypoints[:, :2], depth_m, info)
    points[~valid] = np.nan
    return points
