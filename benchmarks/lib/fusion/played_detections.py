"""Artificial detections of many cameras and people, to measure the time of a tracker."""

import math
import time
from collections.abc import Iterator

import numpy as np

from common.geometry.transforms import (
    LINK_FROM_OPTICAL,
    apply,
    invert,
    rotation_from_rpy,
    transform_from,
)
from people4d.messages import (
    F64,
    Detection,
    Detections,
    Embeddings,
    Message,
    StaticTransform,
    Tracks,
)
from services.tracker.build import build
from services.tracker.config import TrackerConfig

EPOCH_NS = 10**18
RATE_HZ = 15.0
NEAREST = 10  # number of people in view of a camera
ROOM_M = 2.5  # [m] side of the square floor for each person
BINS = 48  # length of an embedding
SECOND_NS = 10**9


def cost(cameras: int, people: int, seconds: float) -> tuple[float, float]:
    """Return the processor time of the tracker a second, and its mean number of tracks.

    Args:
        cameras: Cameras, 15 Hz each.
        people: People on the whole floor; a camera sees the ten nearest.
        seconds: Measured time, after two seconds of warm-up.
    """
    node = build(TrackerConfig(require_transform=True))
    took_s, counts = 0.0, list[int]()
    for arrived_ns, message in played(cameras, people, seconds + 2):
        start_s = time.process_time()
        outputs = node.handle(message, arrived_ns)
        if arrived_ns > EPOCH_NS + 2 * SECOND_NS:
            took_s += time.process_time() - start_s
            counts += [len(output.tracks) for output in outputs if isinstance(output, Tracks)]
    return took_s / seconds, float(np.mean(counts)) if counts else 0.0


def played(cameras: int, people: int, seconds: float) -> Iterator[tuple[int, Message]]:
    """Yield transforms, embeddings and detections by time."""
    rng = np.random.default_rng(7)
    side_m = ROOM_M * math.sqrt(people)
    walks = rng.uniform(0, 2 * math.pi, (people, 2)), rng.uniform(0.1, 0.4, (people, 2))
    homes = rng.uniform(-side_m / 2, side_m / 2, (people, 2))
    histograms = rng.random((people, BINS)) ** 3
    poses = [_pose(k, cameras, side_m) for k in range(cameras)]
    for k, pose in enumerate(poses):
        yield (
            EPOCH_NS,
            StaticTransform(
                stamp_ns=0, sequence=0, parent="map", child=f"c{k}_optical_frame", matrix=pose
            ),
        )
    for frame in range(int(seconds * RATE_HZ)):
        for k, pose in enumerate(poses):
            time_ns = EPOCH_NS + round((frame + k / cameras) / RATE_HZ * 1e9)
            at = homes + np.sin(walks[0] + walks[1] * (time_ns - EPOCH_NS) / 1e9)
            points = np.column_stack([at, np.full(people, 1.1)])
            near = np.argsort(np.linalg.norm(points - pose[:3, 3], axis=1))[:NEAREST]
            found = near[rng.random(len(near)) < 0.95]
            optical = apply(invert(pose), points[found])
            optical += rng.normal(0, 0.03, optical.shape)
            vectors = histograms[found] + rng.normal(0, 0.05, (len(found), BINS)).clip(0)
            vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
            yield (
                time_ns,
                Embeddings(
                    stamp_ns=time_ns,
                    sequence=frame,
                    camera=f"c{k}",
                    model="histogram",
                    detections=tuple(range(len(found))),
                    vectors=vectors.astype(np.float32),
                ),
            )
            yield (
                time_ns,
                Detections(
                    stamp_ns=time_ns,
                    sequence=frame,
                    camera=f"c{k}",
                    frame_id=f"c{k}_optical_frame",
                    model="played",
                    width=640,
                    height=480,
                    detections=tuple(_detection(position) for position in optical),
                ),
            )


def _pose(number: int, count: int, side_m: float) -> F64:
    """Return the pose of a camera on the edge of the floor that looks at its middle."""
    angle = 2 * math.pi * number / count
    turn = rotation_from_rpy(0.0, 0.2, angle + math.pi)
    at = (side_m / 2 * math.cos(angle), side_m / 2 * math.sin(angle), 2.2)
    return transform_from(at, turn) @ LINK_FROM_OPTICAL


def _detection(position_m: F64) -> Detection:
    x, y, z = position_m.tolist()
    depth = max(abs(z), 0.5)
    u, v, half = 320 + 600 * x / depth, 240 + 600 * y / depth, 500 / depth
    box = np.array([u - half / 3, v - half, u + half / 3, v + half], np.float32)
    return Detection(box_xyxy_px=box, score=0.9, position_m=position_m)
