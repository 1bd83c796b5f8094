"""Small messages for the tests of the report."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from people4d.messages import (
    CameraInfo,
    Detection,
    Detections,
    Health,
    Mask,
    RgbdFrame,
    Span,
    StaticTransform,
    Track,
    Tracks,
    Truth,
    TruthPerson,
)
from tests import builders

MS = 10**6
MAP_FROM_OPTICAL = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1], [0, 0, 0, 1]], np.float64)


def frame(stamp_ns: int, camera: str = "front", size: tuple[int, int] = (120, 160)) -> RgbdFrame:
    rgb = np.full((*size, 3), 128, np.uint8)
    depth_mm = np.zeros(size, np.uint16)
    return RgbdFrame(stamp_ns=stamp_ns, sequence=0, camera=camera, rgb=rgb, depth_mm=depth_mm)


def detection(position: bool = True) -> Detection:
    keypoints = np.zeros((17, 3), np.float32)
    keypoints[:, 0], keypoints[:, 1] = np.linspace(60, 90, 17), np.linspace(30, 110, 17)
    keypoints[:10, 2] = 0.9
    return Detection(
        box_xyxy_px=np.array([50, 20, 100, 115], np.float32),
        score=0.8,
        keypoints=keypoints,
        mask=Mask.from_array(np.ones((40, 20), np.uint8), 60, 40),
        position_m=np.array([0.0, 0.0, 2.0]) if position else None,
    )


def detections(
    stamp_ns: int, people: Sequence[Detection] = (), camera: str = "front"
) -> Detections:
    return builders.detections(
        *people, stamp_ns=stamp_ns, camera=camera, model="tiny", width=160, height=120
    )


def track(
    track_id: int,
    x_m: float,
    y_m: float = 0.0,
    state: Literal["tentative", "confirmed", "lost"] = "confirmed",
    detection_index: int | None = None,
) -> Track:
    return builders.track(
        id=track_id,
        state=state,
        position_m=np.array([x_m, y_m, 1.0]),
        velocity_mps=np.array([1.0, 0.0, 0.0]),
        yaw_rad=0.5,
        detection=detection_index,
        score=0.8,
    )


def tracks(
    stamp_ns: int, people: Sequence[Track] = (), camera: str = "front", trace: tuple[Span, ...] = ()
) -> Tracks:
    return builders.tracks(*people, stamp_ns=stamp_ns, tracker="tiny", camera=camera, trace=trace)


def truth(stamp_ns: int, *people: tuple[str, float, float]) -> Truth:
    """People as (id, x, y), walking at (1, 0, 0) m/s."""
    return builders.truth(
        *(
            TruthPerson(
                id=name, position_m=np.array([x, y, 1.0]), velocity_mps=np.array([1.0, 0.0, 0.0])
            )
            for name, x, y in people
        ),
        stamp_ns=stamp_ns,
    )


def info(camera: str = "front") -> CameraInfo:
    return builders.camera_info(camera=camera, width=160, height=120, fx=150.0)


def pose() -> StaticTransform:
    return builders.static_transform(MAP_FROM_OPTICAL)


def span(stage: str, start_ms: float, end_ms: float, process: str = "") -> Span:
    return Span(
        stage=stage,
        process=process or stage.partition(".")[0],
        start_ns=round(start_ms * MS),
        end_ns=round(end_ms * MS),
    )


def health(**counters: int) -> Health:
    return builders.health(counters=counters)
