"""Checks of a camera: frames as declared, their rate and stamps, and images that make sense."""

from collections.abc import Iterator

import numpy as np

from common.diagnosis.evidence import Diagnostic, Evidence, problem, warning
from people4d.messages import CameraInfo, Detection, Detections

REJECTED = {  # counter of rejected frames: what to do
    "wrong_type": "Convert it in the source; for float metres set depth_in_metres = True there.",
    "wrong_size": "Calibrate at the size that is streamed, or stream at the size calibrated.",
    "wrong_unit": "Depth is uint16 millimetres, or float metres with depth_in_metres = True.",
    "wrong_stamp": "Give the acquisition time as an int: round(seconds * 1e9).",
}
STAMPS_MAX_S = 60.0  # by which stamps of a live camera may differ from its host's clock
OFF_CENTRE = 0.2  # largest distance of the principal point from the centre, share of the side
HEIGHTS_M = (0.9, 2.3)  # median apparent heights of people that can be
FEWEST = 10  # people for a median
MIN_CONFIDENCE = 0.5  # confidence of a keypoint
SHOULDERS, HIPS = [5, 6], [11, 12]  # of COCO


def rejected_frames(evidence: Evidence) -> Iterator[Diagnostic]:
    """Report cameras whose frames are not as declared."""
    for vitals in evidence.of("camera"):
        cause = next((name for name in REJECTED if vitals.since(name)), "")
        if cause:
            name = vitals.last.instance
            what = f"frames of {name} are rejected: {vitals.fault or cause}"
            yield problem("frames", what, REJECTED[cause], name)


def rejects_frames(evidence: Evidence) -> bool:
    """Check whether a camera rejects what its source gives."""
    return any(True for _ in rejected_frames(evidence))


def source_rate(evidence: Evidence) -> Iterator[Diagnostic]:
    """Report sources that are slower than their stamps, and the processes that use a core."""
    for vitals in evidence.of("camera"):
        if "source_wanted_hz" not in vitals.last.gauges:
            continue
        loads = [(v.last.gauges.get("cpu_percent", 0.0), n) for n, v in evidence.vitals.items()]
        busy = ", ".join(f"{name} {load:.0f} %" for load, name in sorted(loads)[:-4:-1])
        what = f"{vitals.last.instance}: {vitals.fault}; processor: {busy} of a core"
        hint = (
            "Does another program use the processor? Send fewer frames (--set camera.stride=2), "
            "use more cores, or render a scenario of the lab first (people4d lab render)."
        )
        yield warning("rate", what, hint, vitals.last.instance)


def live_stamps(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that stamps of live cameras are by the clock of their host."""
    for vitals in evidence.of("camera"):
        behind_s = vitals.last.gauges.get("stamps_behind_s", 0.0)
        if abs(behind_s) > STAMPS_MAX_S:
            where = "behind" if behind_s > 0 else "ahead of"
            what = f"stamps of {vitals.last.instance} are {abs(behind_s):.0f} s {where} its host"
            hint = "Give nanoseconds since 1970 (UTC) by the clock of the host, time.time_ns()."
            yield warning("clocks", what, hint)


def principal_points(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that calibrations are of the size of the images."""
    for info in evidence.infos.values():
        if off := off_centre(info):
            what = f"calibration of {info.camera}: {off}"
            hint = "Is the calibration of another image size? Scale fx, fy, cx and cy by the ratio."
            yield warning("calibration", what, hint)


def off_centre(info: CameraInfo) -> str:
    """Return what is wrong with a principal point far from the centre; empty: nothing."""
    parts = info.cx / info.width - 0.5, info.cy / info.height - 0.5
    if max(map(abs, parts)) <= OFF_CENTRE:
        return ""
    where = f"{info.cx:.0f}, {info.cy:.0f}"
    return f"the principal point {where} is far from the centre of {info.width}x{info.height}"


def body_heights(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that people have heights that can be, else calibration or depth is wrong."""
    for camera, info in evidence.infos.items():
        heights_m = [
            height_m
            for message in evidence.detections
            if message.camera == camera
            for detection in message.detections
            if (height_m := _height_m(detection, message, info)) is not None
        ]
        if len(heights_m) < FEWEST:
            continue
        median_m = float(np.median(heights_m))
        if not HEIGHTS_M[0] <= median_m <= HEIGHTS_M[1]:
            what = f"people before {camera} appear {median_m:.1f} m tall"
            hint = "Are fx and fy of its calibration for this image size, and depth millimetres?"
            yield warning("calibration", what, hint)


def _height_m(detection: Detection, message: Detections, info: CameraInfo) -> float | None:
    """Return the apparent height of a person who is in the image from head to foot."""
    _, top, _, bottom = detection.box_xyxy_px.tolist()
    if detection.position_m is None or top < 2 or bottom > message.height - 2:
        return None
    return float((bottom - top) * detection.position_m[2] / info.fy)


def upside_down(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that people stand upright in the images."""
    for camera in sorted({message.camera for message in evidence.detections}):
        found = [
            points[HIPS, 1].mean() < points[SHOULDERS, 1].mean()
            for message in evidence.detections
            if message.camera == camera
            for detection in message.detections
            if (points := detection.keypoints) is not None
            and points[SHOULDERS + HIPS, 2].min() >= MIN_CONFIDENCE
        ]
        if len(found) >= FEWEST and np.mean(found) > 0.5:
            what = f"people in the images of {camera} are upside down"
            hint = (
                "Is it mounted so? Give its mount (camera.mount_rpy_rad, or the transform of its "
                "driver), by which its images are turned upright."
            )
            yield problem("mount", what, hint)


CAMERA_CHECKS = (
    *(rejected_frames, source_rate, live_stamps),
    *(principal_points, body_heights, upside_down),
)
