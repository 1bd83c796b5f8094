"""Observation of joints in one frame: their lines of sight and the surfaces on them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F64, CameraInfo, Detection
from services.skeleton.body import INSIDE_M, JOINT_COUNT
from services.skeleton.config import JointFilterConfig


@dataclass
class JointObservation:
    """Joints of N people in one frame, in the fixed frame."""

    origin_m: F64  # 3, of the camera
    confidence: F64  # Nx17, 0: not observed
    rays: F64  # Nx17x3, unit, from the camera
    range_m: F64  # Nx17, of the joint behind the surface that was read; NaN: no reading
    along_m: F64  # Nx17, standard deviation along the ray
    across_per_m: float  # standard deviation across it, of the image, at one metre of range

    def exchange(self, person: int, joints: Sequence[int], others: Sequence[int]) -> None:
        """Give a person's joints the observations of others."""
        for values in (self.confidence, self.rays, self.range_m, self.along_m):
            values[person, joints] = values[person, others]


def observe(
    detections: Sequence[Detection | None],
    info: CameraInfo,
    fixed_from_optical: F64,
    config: JointFilterConfig,
) -> JointObservation:
    """Return what the detections of N people show; None: not detected.

    Keypoints that are not confident are left out.
    """
    count = len(detections)
    keypoints = np.zeros((count, JOINT_COUNT, 3))
    depth_m = np.zeros((count, JOINT_COUNT))
    for row, detection in enumerate(detections):
        if detection is not None and detection.keypoints is not None:
            keypoints[row] = detection.keypoints
            if detection.keypoint_depths_m is not None:
                depth_m[row] = detection.keypoint_depths_m
    confidence = np.where(keypoints[..., 2] > config.confidence_min, keypoints[..., 2], 0.0)
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
        along_m=np.hypot(config.along_m, config.along_per_m * np.nan_to_num(range_m) ** 2),
        across_per_m=config.across_px / info.fx,
    )
