"""A short recording of one person before a flat wall, with everything that viewers show."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from common.io.recording import RecordingWriter
from people4d.messages import Message, PersonSkeleton, Skeletons, Span
from people4d.messages.prediction import MotionProbabilities, PersonPrediction, Predictions
from tests import builders

S = 10**9
FRAMES = 5
START_NS = 1_700_000_000 * S
DEPTH_MM = 2000
MAP_FROM_OPTICAL = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1.2], [0, 0, 0, 1]], float)


def keypoints() -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    """Seventeen keypoints in a column of the image, all confident but the first."""
    found = np.zeros((17, 3), np.float32)
    found[:, 0], found[:, 1], found[:, 2] = 80, np.linspace(30, 100, 17), 0.9
    found[0, 2] = 0.1
    return found


def skeletons(stamp_ns: int = START_NS, camera: str = "front") -> Skeletons:
    """Return the skeleton of one person, with a predicted nose."""
    person = PersonSkeleton(
        id=7,
        state="confirmed",
        positions_m=np.tile(np.array([2.0, 0.0, 1.0], np.float32), (17, 1)),
        covariances_m2=np.tile(np.eye(3, dtype=np.float32) * 0.01, (17, 1, 1)),
        measured=(False,) + (True,) * 16,
    )
    return Skeletons(stamp_ns=stamp_ns, sequence=0, frame_id="map", camera=camera, people=(person,))


def messages() -> Iterator[tuple[int, Message]]:
    """Log times and messages, frames of 160x120."""
    info = builders.camera_info(width=160, height=120, fx=150.0)
    yield START_NS, info
    yield START_NS, builders.static_transform(MAP_FROM_OPTICAL)
    rng = np.random.default_rng(1)
    rgb = np.repeat(np.repeat(rng.integers(0, 255, (15, 20, 3), np.uint8), 8, 0), 8, 1)
    for k in range(FRAMES):
        stamp_ns = START_NS + k * S // 10
        head: dict[str, Any] = {"stamp_ns": stamp_ns, "sequence": k}
        depth_mm = np.full((120, 160), DEPTH_MM + k, np.uint16)
        yield stamp_ns, builders.odometry(**head, x_m=0.1 * k)
        yield stamp_ns, builders.moving_transform(np.eye(4), **head)
        yield stamp_ns, builders.rgbd_frame(**head, rgb=rgb, depth_mm=depth_mm)
        person = builders.detection(
            box_xyxy_px=np.array([60, 20, 100, 110], np.float32),
            keypoints=keypoints(),
            keypoint_depths_m=np.full(17, (DEPTH_MM + k) / 1000, np.float32),
            position_m=np.array([0.0, 0.0, 2.0]),
        )
        yield stamp_ns, builders.detections(person, width=160, height=120, **head)
        track = builders.track(position_m=np.array([2.0, 0.1 * k, 1.2]), yaw_rad=0.5, id=7)
        trace = [
            Span(
                stage=f"{name}.work",
                process=f"{name}-1@host",
                start_ns=start,
                end_ns=start + S // 100,
            )
            for name, start in (("camera", stamp_ns), ("tracker", stamp_ns + S // 50))
        ]
        yield stamp_ns, builders.tracks(track, **head, trace=tuple(trace))
        yield (
            stamp_ns,
            Predictions(
                **head,
                frame_id="map",
                camera="front",
                horizons_s=(1.0, 2.0),
                people=(
                    PersonPrediction(
                        id=7,
                        state="confirmed",
                        position_m=track.position_m,
                        velocity_mps=np.zeros(2),
                        motion=MotionProbabilities(standing=1.0, going_on=0.0, turning=0.0),
                        means_m=np.array([[2.0, 1.0], [2.0, 2.0]]),
                        covariances_m2=np.tile(np.eye(2) * 0.01, (2, 1, 1)),
                    ),
                ),
            ),
        )
        yield stamp_ns, builders.health(**head)


def record(path: Path) -> Path:
    """Write the recording."""
    with RecordingWriter(path) as writer:
        for log_time_ns, message in messages():
            writer.write(message, log_time_ns)
    return path
