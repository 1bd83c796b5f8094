"""Observation of joints in one frame: lines of sight and surfaces."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F64, CameraInfo, Detection
from services.skeleton.body import INSIDE_M, JOINT_COUNT

CONFIDENCE_MIN = 0.1  # minimum confidence of a used keypoint
ACROSS_PX = 2.0  # standard deviation of a keypoint in the image [px]
ALONG_M = 0.04  # standard deviation of a joint along the line of sight, behind the surface [m]
ALONG_PER_M = 0.003  # growth of the standard deviation with the squared distance [1/m]


@dataclass
class JointObservation:
    """Joints of N people in one frame, in the fixed frame."""

    origin_m: F64  # 3, position of the camera
    confidence: F64  # Nx17, 0: not observed
    rays: F64  # Nx17x3, unit vectors from the camera
    range_m: F64  # Nx17, range of the joint behind the measured surface; NaN: no reading
    along_m: F64  # Nx17, standard deviation along the ray
    across_per_m: float  # standard deviation across the ray by the image, per metre of range

    def exchange_joints(self, person: int, joints: Sequence[int], others: Sequence[int]) -> None:
        """Replace the observations of a person's joints by the observations of other joints."""
        for values in (self.confidence, self.rays, self.range_m, self.along_m):
            values[person, joints] = values[person, others]


def observe_joints(
    detections: Sequence[Detection | None], info: CameraInfo, fixed_from_optical: F64
) -> JointObservation:
    """Return the observed joints of N people (None: not detected), without weak keypoints."""
    count = len(detections)
    keypoints = np.zeros((count, JOINT_COUNT, 3))
    depth_m = np.zeros((count, JOINT_COUNT))
    for row, detection in enumerate(detections):
        if detection is not None and detection.keypoints is not None:
            keypoints[row] = detection.keypoints
            if detection.keypoint_depths_m is not None:
                depth_m[row] = detection.keypoint_depths_m
    confidence = np.where(keypoints[..., 2] > CONFIDENCE_MIN, keypoints[..., 2], 0.0)
    flat = deproject(keypoints[..., :2].reshape(-1, 2), np.ones(count * JOINT_COUNT), info)
    slant = np.linalg.norm(flat, axis=1)
    rays = (flat / slant[:, None]) @ fixed_from_optical[:3, :3].T
    slant = slant.reshape(count, JOINT_COUNT)
    with np.errstate(invalid="ignore"):
        range_m = np.where(depth_m > 0, depth_m * slant + INSIDE_M, np.nan)
    return JointObservation(
        origin_m=fixed_from_optical[:3, 3],
        confidence=confidence,
        rays=rays.reshape(count, JOINT_COUNT, 3),
        range_m=range_m,
        along_m=np.hypot(ALONG_M, ALONG_PER_M * np.nan_to_num(range_m) ** 2),
        across_per_m=ACROSS_PX / info.fx,
    )
