"""Calibrations that several tests of the detector use."""

from people4d.messages import F64, CameraInfo

INFO = CameraInfo(
    stamp_ns=0,
    sequence=0,
    camera="front",
    frame_id="front_optical_frame",
    width=40,
    height=60,
    fx=50.0,
    fy=50.0,
    cx=20.0,
    cy=30.0,
)


def lab_info(lens: F64) -> CameraInfo:
    """Calibration of the simulated room's camera from its fx, fy, cx and cy."""
    fx, fy, cx, cy = map(float, lens)
    return CameraInfo(
        stamp_ns=0,
        sequence=0,
        camera="lab",
        frame_id="lab",
        width=640,
        height=480,
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
    )
