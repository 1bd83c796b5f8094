"""Build the node of the service from its configuration, and compile its kernels."""

from collections import Counter

import numpy as np

from people4d.messages import CameraInfo
from services.gait.cascade import PersonObservation
from services.gait.config import GaitConfig
from services.gait.estimator import ESTIMATOR_COUNTERS, GaitEstimator, GaitFrame, OnFrame
from services.gait.node import GaitNode
from services.gait.points.normal import Normal
from services.gait.steps.walk import WalkSamples, fit_walk

HEIGHT, WIDTH, FOCAL_PX = 120, 160, 120.0  # Image of the warm-up [px]
FIGURE_MM, WALL_MM, CAMERA_MM = 2500, 4000, 1000  # Depth, depth, height above the floor [mm]
# Rows, columns and depth [mm] of a figure
PARTS = (
    (slice(20, 33), slice(75, 85), FIGURE_MM),  # head
    (slice(33, 70), slice(70, 90), FIGURE_MM),  # torso
    (slice(70, 110), slice(70, 78), FIGURE_MM),  # legs
    (slice(70, 110), slice(82, 90), FIGURE_MM),
    (slice(52, 62), slice(70, 80), FIGURE_MM - 200),  # a hand before the torso
)
BOX = np.array((68.0, 18.0, 92.0, 112.0))
PERIOD_NS = 33_000_000


def warm_up(config: GaitConfig) -> None:
    """Track two people, drawn as rectangles, for three frames; the last one has no boxes."""
    info = CameraInfo(
        stamp_ns=0,
        sequence=0,
        camera="none",
        frame_id="none",
        width=WIDTH,
        height=HEIGHT,
        fx=FOCAL_PX,
        fy=FOCAL_PX,
        cx=WIDTH / 2,
        cy=HEIGHT / 2,
    )
    rgb = np.full((HEIGHT, WIDTH, 3), (120, 130, 140), np.uint8)
    down = np.arange(HEIGHT) - HEIGHT / 2
    floor_mm = FOCAL_PX * CAMERA_MM / np.maximum(down, FOCAL_PX * CAMERA_MM / WALL_MM)
    depth_mm = np.repeat(floor_mm.astype(np.uint16)[:, None], WIDTH, axis=1)
    for rows, columns, distance_mm in PARTS:
        rgb[rows, columns] = (200, 40, 40)
        depth_mm[rows, columns] = distance_mm
    # read-only as decoded images: kernels are compiled for such arrays
    for image in (rgb, depth_mm):
        image.flags.writeable = False
    keypoints = np.zeros((17, 3), np.float32)
    estimator = GaitEstimator(config, info, Counter(dict.fromkeys(ESTIMATOR_COUNTERS, 0)))
    for number, box in enumerate((BOX, BOX, None)):
        observations = [
            PersonObservation(id=key, box_xyxy_px=box, keypoints=keypoints, depth_m=2.5)
            for key in (1, 2)
        ]
        estimator.update_people(
            GaitFrame(number * PERIOD_NS, rgb, depth_mm, observations, np.eye(4))
        )
    # kernels of limbs and walks, which three frames do not reach
    times_s = np.arange(3.0)
    fit_walk(WalkSamples(times_s, np.zeros((3, 2)), np.zeros((3, 2, 2)), np.ones((3, 2, 2, 2))))
    one = Normal(np.ones(3), np.eye(3))
    one.fused(one).at_pixel(np.zeros(2), 1.0, info).distances2(np.ones((1, 3)))


def build(config: GaitConfig, on_frame: OnFrame | None = None) -> GaitNode:
    """Build the node; `on_frame` is called with every processed frame."""
    return GaitNode(config, on_frame)


def build_compiled(config: GaitConfig) -> GaitNode:
    """Build the node after compiling its kernels."""
    warm_up(config)
    return build(config)
