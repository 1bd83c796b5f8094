"""Delays of messages from cameras to the tracker. Those of one camera stay in order."""

from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np

from benchmarks.lib.fusion.changes import Change, late_clock, nothing
from benchmarks.lib.fusion.scene import FusionScene
from people4d.messages import Detections, Message

FrameKey: TypeAlias = tuple[str, int]  # camera and sequence
Delays: TypeAlias = Callable[[FusionScene], Mapping[FrameKey, int]]  # [ns], of nothing else


def key_of(message: Message) -> FrameKey:
    """Return the frame that a message belongs to."""
    return getattr(message, "camera", ""), message.sequence


def in_time(scene: FusionScene) -> Mapping[FrameKey, int]:  # noqa: ARG001
    """Return no delays."""
    return {}


def constant(late_ms: Mapping[str, float]) -> Delays:
    """Return delays that do not change, by camera [ms]."""

    def delays(scene: FusionScene) -> Mapping[FrameKey, int]:
        return {
            key_of(message): int(late_ms.get(message.camera, 0) * 1e6)
            for _, message in scene.messages
            if isinstance(message, Detections)
        }

    return delays


def jittering(most_ms: Mapping[str, float]) -> Delays:
    """Return delays of each frame, uniform from 0 to the most of its camera [ms]."""

    def delays(scene: FusionScene) -> Mapping[FrameKey, int]:
        rng = np.random.default_rng(7)
        found, last_ns = dict[FrameKey, int](), dict[str, int]()
        for time_ns, message in scene.messages:
            if not isinstance(message, Detections):
                continue
            camera = message.camera
            arrived_ns = time_ns + int(rng.uniform(0, most_ms.get(camera, 0)) * 1e6)
            last_ns[camera] = max(arrived_ns, last_ns.get(camera, 0))
            found[key_of(message)] = last_ns[camera] - time_ns
        return found

    return delays


def late_cases(start_ns: int) -> dict[str, tuple[Change, Delays]]:
    """Return changes of stamps and delays of messages of four cameras by name.

    Args:
        start_ns: Time at which a clock that drifts was right.
    """
    every = ("c1", "c2", "c3", "c4")
    cases: dict[str, tuple[Change, Delays]] = {"in time": (nothing, in_time)}
    for late_ms in (40, 100, 300):
        cases[f"all {late_ms} ms late"] = nothing, constant(dict.fromkeys(every, late_ms))
    for late_ms in (40, 100, 300):
        cases[f"c2 {late_ms} ms late"] = nothing, constant({"c2": late_ms})
    cases["c1, the reference, 300 ms late"] = nothing, constant({"c1": 300})
    steps = dict(zip(every, (0, 100, 200, 300), strict=True))
    cases["c1 to c4 0, 100, 200, 300 ms late"] = nothing, constant(steps)
    for most_ms in (100, 300):
        jitter = jittering(dict.fromkeys(every, most_ms))
        cases[f"all late by 0 to {most_ms} ms"] = nothing, jitter
    cases["c2 late by 0 to 300 ms"] = nothing, jittering({"c2": 300})
    for seconds in (-0.1, 0.1, -0.5, 0.5):
        name = f"clock of c2 {abs(seconds)} s {'ahead' if seconds > 0 else 'behind'}"
        cases[name] = late_clock("c2", seconds, 0.0, start_ns), in_time
    both = late_clock("c2", -0.2, 0.0, start_ns), constant({"c2": 100})
    cases["clock of c2 0.2 s behind, and 100 ms late"] = both
    cases["clock of c2 drifts by 100 ppm"] = late_clock("c2", 0.0, 100.0, start_ns), in_time
    return cases
