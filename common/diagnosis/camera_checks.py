"""Checks of a camera: the rate of its source, its calibration and its orientation."""

from collections.abc import Iterator

import numpy as np

from common.diagnosis.evidence import Diagnostic, Evidence, problem, warning
from people4d.messages import CameraInfo, Detection, Detections

OFF_CENTRE = 0.2  # maximum distance of the principal point from the centre, share of the side
HEIGHTS_M = (0.9, 2.3)  # plausible median apparent heights of people [m]
FEWEST = 10  # minimum number of people for a median
MIN_CONFIDENCE = 0.5  # minimum confidence of a keypoint
SHOULDERS, HIPS = [5, 6], [11, 12]  # COCO keypoints


def source_rate(evidence: Evidence) -> Iterator[Diagnostic]:
    """Report sources slower than their stamps, and processes that use a whole core."""
    for vitals in evidence.of_service("camera"):
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


def principal_points(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that calibrations fit the size of the images."""
    for info in evidence.infos.values():
        if off := off_centre(info):
            what = f"calibration of {info.camera}: {off}"
            hint = "Is the calibration of another image size? Scale fx, fy, cx and cy by the ratio."
            yield warning("calibration", what, hint)


def off_centre(info: CameraInfo) -> str:
    """Describe a principal point far from the centre; empty if it is near."""
    parts = info.cx / info.width - 0.5, info.cy / info.height - 0.5
    if max(map(abs, parts)) <= OFF_CENTRE:
        return ""
    where = f"{info.cx:.0f}, {info.cy:.0f}"
    return f"the principal point {where} is far from the centre of {info.width}x{info.height}"


def body_heights(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that people have plausible heights: calibration and depth agree."""
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
    """Return the apparent height of a person; None unless head and feet are in the image."""
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


CAMERA_CHECKS = (source_rate, principal_points, body_heights, upside_down)
