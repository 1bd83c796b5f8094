"""Calibrations that several tests of the detector use."""

from people4d.messages import F64, CameraInfo
from tests import builders

INFO = builders.camera_info(width=40, height=60, fx=50.0)


def lab_info(lens: F64) -> CameraInfo:
    """Calibration of the simulated room's camera from its fx, fy, cx and cy."""
    fx, fy, cx, cy = map(float, lens)
    return builders.camera_info(camera="lab", frame_id="lab", fx=fx, fy=fy, cx=cx, cy=cy)
