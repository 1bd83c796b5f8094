"""Names of frames as messages allow them, of names that ROS allows."""

import re

OPTICAL_FRAME = "camera_optical_frame"  # of a camera that names none


def frame_name(name: str) -> str:
    """Return the name of a frame as messages allow it: no slashes, at most 64 characters."""
    allowed = re.sub(r"[^A-Za-z0-9_.-]", "_", name.strip("/")).lstrip(".-")
    return allowed[:64] or OPTICAL_FRAME
