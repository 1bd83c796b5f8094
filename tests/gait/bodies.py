"""Bodies of known shape, as a camera would see them."""

import numpy as np
import numpy.typing as npt

from people4d.messages import CameraInfo
from services.gait.surface.body import Body
from services.gait.surface.body_config import BodyConfig

INFO = CameraInfo(
    stamp_ns=0,
    sequence=0,
    camera="front",
    frame_id="front",
    width=640,
    height=480,
    fx=500.0,
    fy=500.0,
    cx=320.0,
    cy=240.0,
)

# The paper's rules as they are: fixed thresholds, each pixel a vertex, nothing smoothed or joined.
PAPER = BodyConfig(
    fill_passes=1,
    fill_neighbours=1,
    continuity_per_m=0.0,
    noise_sigmas=0.0,
    edge_stretch=0.0,
    edge_noise_per_m2=0.0,
    smooth_px=0,
    join_m=0.0,
    normal_passes=0,
    vertices=0,
    pixels_min=1,
)


def body_of(depth_m: npt.ArrayLike, left_px: int = 0, top_px: int = 0) -> Body:
    """A body of all pixels that have depth."""
    depth = np.asarray(depth_m, np.float32)
    return Body(left_px=left_px, top_px=top_px, depth_m=depth, mask=depth > 0)
