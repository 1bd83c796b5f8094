"""Names of frames in people4d, converted from names in ROS."""

import re

OPTICAL_FRAME = "camera_optical_frame"  # default name


def frame_name(name: str) -> str:
    """Return a valid name of a frame: no slashes, at most 64 characters."""
    allowed = re.sub(r"[^A-Za-z0-9_.-]", "_", name.strip("/")).lstrip(".-")
    return allowed[:64] or OPTICAL_FRAME
