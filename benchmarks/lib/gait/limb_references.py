"""True positions of hands and feet by joints.

Hands and feet are on the surface of the body, joints are inside of it. The reference of a hand is
beyond the wrist along the forearm, the reference of a foot ahead of the ankle; both are moved
towards the camera.
"""

import numpy as np

from people4d.messages import F64

JOINT = (9, 10, 15, 16)  # COCO: wrists, ankles
BEFORE = (7, 8, 13, 14)  # elbows, knees
HAND_REACH = 0.35  # distance from the wrist to the middle of the hand [forearms]
HAND_DEEP_M, FOOT_DEEP_M = 0.02, 0.03  # distance from the middle to the visible surface [m]
FOOT_AHEAD_M, FOOT_BELOW_M = 0.08, 0.03  # offset from the ankle to the middle of the foot [m]


def references(joints_m: F64, camera_m: F64) -> F64:
    """Return the middles of hands and feet of K people in N frames: NxKx4x3.

    Args:
        joints_m: NxKx17x3, COCO order, a fixed frame with z up.
        camera_m: Nx3, position of the camera.
    """
    found = np.empty((*joints_m.shape[:2], 4, 3))
    shoulders = joints_m[:, :, 6] - joints_m[:, :, 5]
    hips = joints_m[:, :, 12] - joints_m[:, :, 11]
    across = (shoulders + hips) * (1.0, 1.0, 0.0)
    ahead = np.cross((0.0, 0.0, 1.0), across)  # vector from left to right, turned ahead
    ahead /= np.maximum(np.linalg.norm(ahead, axis=-1, keepdims=True), 1e-9)
    for k, (joint, before) in enumerate(zip(JOINT, BEFORE, strict=True)):
        end = joints_m[:, :, joint]
        if k < 2:
            middle = end + HAND_REACH * (end - joints_m[:, :, before])
            deep = HAND_DEEP_M
        else:
            middle = end + FOOT_AHEAD_M * ahead - (0.0, 0.0, FOOT_BELOW_M)
            deep = FOOT_DEEP_M
        ray = middle - camera_m[:, None]
        found[:, :, k] = middle - deep * ray / np.linalg.norm(ray, axis=-1, keepdims=True)
    return found
