"""Annotations of recordings of real people, which are not published.

All pixels (u, v) were picked by hand in the colour images.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from people4d.messages import Detection
from services.camera.config import CameraConfig
from services.tracker.sort3d.association import assign

Pixel = tuple[int, int]

# Pose of the camera over the floor of filinha, from a plane through the free floor of its first
# frame: 88 % of the points there lie within 3 cm of it. People's ears are then 1.67 m above the
# floor (median; half of them within 5 cm), wherever they walk.
MOUNT_XYZ_M = (0.0, 0.0, 2.345)
MOUNT_RPY_RAD = (-0.227, 0.464, 0.0)
FPS = 10.0  # frame rate [Hz], since the image pairs have no stamps

# Frames of filinha, from 0, with a point on each visible person, by a name for each person.
# In frame 52 only the top of the head of "white" is visible, in 68 and 76 half of "striped".
CROSSING: dict[int, dict[str, Pixel]] = {
    44: {"navy": (105, 160), "jeans": (245, 136), "grey": (160, 395)},
    52: {"navy": (46, 309), "jeans": (128, 111), "grey": (293, 222), "white": (256, 371)},
    60: {"jeans": (130, 187), "grey": (210, 125), "white": (272, 217), "striped": (324, 322)},
    68: {"grey": (107, 125), "white": (221, 131), "striped": (272, 150), "purple": (318, 267)},
    76: {"grey": (167, 225), "white": (120, 114), "striped": (222, 95), "purple": (284, 169)},
    84: {"white": (132, 213), "striped": (110, 80), "purple": (219, 95)},
}

# Chest, middle and belly of the man in front in the TUE bags (one frame each), with the depth in
# millimetres that the depth image has there.
TORSO_MM: dict[str, dict[Pixel, int]] = {
    "2019-05-03-12-41-38": {(300, 150): 2040, (310, 190): 1947, (320, 230): 1947},
    "2019-05-03-12-42-18": {(340, 150): 1785, (340, 200): 1722, (330, 270): 1705},
    "2019-05-03-12-42-25": {(340, 150): 1785, (340, 200): 1722, (330, 270): 1705},
    "2019-05-03-12-42-30": {(355, 180): 1722, (355, 230): 1696, (350, 270): 1688},
    "2019-05-03-12-42-34": {(340, 160): 1757, (345, 220): 1705, (340, 270): 1696},
}


def crossing_camera(shared: Path, start_s: float = 0.0, max_frames: int = 0) -> CameraConfig:
    """Return the configuration that plays filinha, in which six people cross, in lock-step."""
    return CameraConfig(
        source=str(shared / "data" / "rgbd" / "filinha"),
        options={"fps": FPS},
        mount_xyz_m=MOUNT_XYZ_M,
        mount_rpy_rad=MOUNT_RPY_RAD,
        playback="lockstep",
        window=1,
        start_delay_s=0.0,
        start_s=start_s,
        max_frames=max_frames,
    )


def match(points: Sequence[Pixel], detections: Sequence[Detection]) -> list[tuple[int, int]]:
    """Return pairs (point, detection) of points in boxes, each at most once."""
    cost = np.full((len(points), len(detections)), np.inf)
    for i, (u, v) in enumerate(points):
        for j, detection in enumerate(detections):
            left, top, right, bottom = map(float, detection.box_xyxy_px)
            if left <= u <= right and top <= v <= bottom:
                cost[i, j] = abs(2 * u - left - right) + abs(2 * v - top - bottom)
    return assign(cost)
