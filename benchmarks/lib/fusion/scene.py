"""A recorded scene of the lab with several cameras, and embeddings of its people."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from common.geometry.transforms import invert
from common.io.recording import open_recording
from common.metrics.field_of_view import in_view
from common.metrics.record import BOOL
from people4d.messages import (
    F64,
    CameraInfo,
    Detections,
    Embeddings,
    Message,
    StaticTransform,
    Truth,
)

BINS = 48  # length of the synthetic embeddings
GAIN_SIGMA = 0.15  # standard deviation of the logarithm of a camera's factors
SAME_M = 0.4  # [m] maximum distance from a detection to its person


@dataclass(frozen=True)
class FusionScene:
    """A recorded scene with all cameras."""

    messages: Sequence[tuple[int, Message]]  # true time [ns], and message
    infos: Mapping[str, CameraInfo]
    poses: Mapping[str, F64]  # map_from_camera, 4x4
    times_ns: F64  # T, stamps of the ground truth
    people_m: F64  # TxPx3

    def positions_m(self, time_ns: int) -> F64:
        """Return the true positions (Px3) at a time."""
        k = int(np.clip(np.searchsorted(self.times_ns, time_ns), 1, len(self.times_ns) - 1))
        before, after = self.times_ns[k - 1], self.times_ns[k]
        share = float(np.clip((time_ns - before) / (after - before), 0, 1))
        return np.asarray((1 - share) * self.people_m[k - 1] + share * self.people_m[k])

    def views(self, positions_m: F64) -> dict[str, BOOL]:
        """Return flags (P each) of people in the view of each camera."""
        return {
            name: in_view(positions_m, invert(self.poses[name]), info)
            for name, info in self.infos.items()
        }


def read_fusion_scene(path: Path, seed: int) -> FusionScene:
    """Read a recording of detections, and make embeddings of its people.

    An embedding is a histogram of the person with noise, its bins scaled by lognormal factors of
    the camera.
    """
    recorded = list(open_recording(path).messages())
    truths = [m for _, m in recorded if isinstance(m, Truth)]
    scene = FusionScene(
        messages=[],
        infos={m.camera: m for _, m in recorded if isinstance(m, CameraInfo)},
        poses={
            m.child.removesuffix("_optical_frame"): m.matrix
            for _, m in recorded
            if isinstance(m, StaticTransform)
        },
        times_ns=np.array([m.stamp_ns for m in truths], np.float64),
        people_m=np.array([[p.position_m for p in m.people] for m in truths]),
    )
    rng = np.random.default_rng([seed, 0xE3B])
    appearances = rng.random((scene.people_m.shape[1], BINS)) ** 3
    gains = {name: rng.lognormal(0, GAIN_SIGMA, BINS) for name in sorted(scene.infos)}
    messages: list[tuple[int, Message]] = []
    for time_ns, message in recorded:
        if isinstance(message, Detections):
            truth = scene.positions_m(time_ns)
            pose = scene.poses[message.camera]
            messages.append(
                (
                    time_ns,
                    _embeddings(message, truth, pose, appearances * gains[message.camera], rng),
                )
            )
        if not isinstance(message, Truth):
            messages.append((time_ns, message))
    return replace(scene, messages=messages)


def _embeddings(
    frame: Detections, truth_m: F64, pose: F64, histograms: F64, rng: np.random.Generator
) -> Embeddings:
    indices, vectors = list[int](), list[F64]()
    for index, detection in enumerate(frame.detections):
        vector = rng.random(BINS) ** 3
        if detection.position_m is not None:
            at = pose[:3, :3] @ detection.position_m + pose[:3, 3]
            distance = np.linalg.norm(truth_m - at, axis=1)
            if distance.min() < SAME_M:
                vector = histograms[int(distance.argmin())]
        noisy = np.maximum(vector + rng.normal(0, 0.06, BINS), 0)
        indices.append(index)
        vectors.append(noisy / np.linalg.norm(noisy))
    return Embeddings(
        stamp_ns=frame.stamp_ns,
        sequence=frame.sequence,
        camera=frame.camera,
        model="histogram",
        detections=tuple(indices),
        vectors=np.array(vectors, np.float32).reshape(-1, BINS),
    )
