"""Largest gain of corrections of several cameras: each is given its true values."""

from collections.abc import Iterator, Sequence

import numpy as np
from msgspec.structs import replace

from benchmarks.lib.fusion.changes import Change, nothing
from benchmarks.lib.fusion.run import TimedTracks, track
from benchmarks.lib.fusion.scene import SAME_M, FusionScene
from people4d.messages import F64, Detections, Message

SAMPLES_MIN = 100  # people of a camera, for its mean error


def gains(
    scene: FusionScene, same_colours: FusionScene
) -> Iterator[tuple[str, Sequence[TimedTracks]]]:
    """Yield names of corrections, or of what could be corrected, and the tracks with them.

    Args:
        scene: The scene.
        same_colours: The same with embeddings that do not depend on the camera.
    """
    yield "as it is", track(scene, nothing)[0]
    yield "colours alike in all cameras", track(same_colours, nothing)[0]
    yield "each camera's mean error taken away", track(scene, without_bias(scene))[0]


def without_bias(scene: FusionScene) -> Change:
    """Return the change by which the mean error of each camera, in its optical frame, is zero."""
    bias_m = mean_errors_m(scene)

    def change(time_ns: int, message: Message) -> Message | None:  # noqa: ARG001
        if not isinstance(message, Detections) or message.camera not in bias_m:
            return message
        people = tuple(
            d
            if d.position_m is None
            else replace(d, position_m=d.position_m - bias_m[message.camera])
            for d in message.detections
        )
        return replace(message, detections=people)

    return change


def mean_errors_m(scene: FusionScene) -> dict[str, F64]:
    """Return the mean error of positions (3) of each camera, right, down and along its axis."""
    errors: dict[str, list[F64]] = {}
    for time_ns, message in scene.messages:
        if not isinstance(message, Detections):
            continue
        pose, truth_m = scene.poses[message.camera], scene.positions_m(time_ns)
        for detection in message.detections:
            if detection.position_m is None:
                continue
            at_m = pose[:3, :3] @ detection.position_m + pose[:3, 3]
            nearest_m = truth_m[int(np.linalg.norm(truth_m - at_m, axis=1).argmin())]
            if np.linalg.norm(nearest_m - at_m) < SAME_M:
                errors.setdefault(message.camera, []).append(pose[:3, :3].T @ (at_m - nearest_m))
    return {
        camera: np.mean(found, axis=0)
        for camera, found in errors.items()
        if len(found) >= SAMPLES_MIN
    }
