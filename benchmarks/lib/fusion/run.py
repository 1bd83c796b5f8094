"""Tracks of several cameras of a scene, by one tracker and by a merger of single trackers."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from benchmarks.lib.fusion.changes import Change
from benchmarks.lib.fusion.scene import FusionScene
from common.diagnosis.clock_checks import clocks
from common.diagnosis.evidence import Evidence
from common.runtime.node import Node, Status
from people4d.messages import Detections, Health, Message, Track, Tracks
from services.tracker.build import build
from services.tracker.config import TrackerConfig

ARRIVAL_NS = 60_000_000  # [ns] delay of detections after their frame
MERGED_M = 0.5  # [m] maximum distance of tracks that the merger joins
FRESH_NS = 250_000_000  # [ns] maximum age of tracks in the merger


@dataclass(frozen=True)
class TimedTracks:
    """Tracks with the true time of their frame."""

    time_ns: int
    tracks: Sequence[Track]


@dataclass(frozen=True)
class Statement:
    """A reason in the tracker's health, or a diagnostic of the doctor about clocks."""

    first_ns: int  # [ns] true time of the first sentence that is equal except for numbers
    text: str  # last such sentence
    count: int


def track(
    scene: FusionScene, change: Change, cameras: Sequence[str] = ()
) -> tuple[list[TimedTracks], list[Statement]]:
    """Return the tracks and reports of one tracker with some cameras, by default all."""
    node = build(TrackerConfig(require_transform=True))
    times = {
        (m.camera, m.stamp_ns): time_ns
        for time_ns, original in scene.messages
        if isinstance(original, Detections)
        and isinstance(m := change(time_ns, original), Detections)
    }
    found = []
    reported = dict[str, Statement]()
    for time_ns, original in scene.messages:
        arrived_ns = time_ns + ARRIVAL_NS
        message = change(time_ns, original)
        if message is None or not _is_of(message, cameras):
            continue
        for output in _handle(node, message, arrived_ns):
            key = (output.camera, output.stamp_ns)
            if key in times:
                found.append(TimedTracks(times[key], output.tracks))
        if isinstance(message, Detections) and message.sequence % 50 == 0:
            for text in _sentences(node.status(), time_ns):
                pattern = re.sub(r"\d+", "#", text)
                before = reported.get(pattern, Statement(time_ns, text, 0))
                reported[pattern] = Statement(before.first_ns, text, before.count + 1)
    return found, sorted(reported.values(), key=lambda statement: statement.first_ns)


def _sentences(status: Status, time_ns: int) -> list[str]:
    """Return the reasons of a tracker, and the diagnostics of the doctor about its clocks."""
    health = Health(
        stamp_ns=time_ns,
        sequence=0,
        service="tracker",
        instance="tracker-1",
        host="here",
        pid=1,
        state="ready",
        gauges=status.gauges,
    )
    evidence = Evidence(robot="robot")
    evidence.add_message(health, time_ns)
    clock = [f"doctor: {one.what}" for one in clocks(evidence) if one.level != "ok"]
    return [*(reason for reason in status.reason.split("; ") if reason), *clock]


def _is_of(message: Message, cameras: Sequence[str]) -> bool:
    camera = getattr(message, "camera", "")
    return not cameras or not camera or camera in cameras


def _handle(node: Node, message: Message, now_ns: int) -> Iterator[Tracks]:
    outputs: list[Message] = []
    while (wake_ns := node.wake_ns()) is not None and wake_ns <= now_ns:
        more = node.tick(wake_ns)
        outputs += more
        if not more:
            break
    outputs += node.handle(message, now_ns)
    yield from (output for output in outputs if isinstance(output, Tracks))


def merge(single: Mapping[str, Sequence[TimedTracks]]) -> list[TimedTracks]:
    """Return the tracks of single cameras, each joined to the nearest of another within 0.5 m.

    A joined track gets the number of the earlier one.
    """
    order = sorted((t.time_ns, camera, t) for camera, ts in single.items() for t in ts)
    newest: dict[str, TimedTracks] = {}
    numbers: dict[tuple[str, int], int] = {}
    merged = []
    for time_ns, camera, timed in order:
        newest[camera] = timed
        people: dict[int, list[Track]] = {}
        for name, last in newest.items():
            if time_ns - last.time_ns > FRESH_NS:
                continue
            for one in last.tracks:
                key = name, one.id
                if key not in numbers:
                    near = [
                        (float(np.linalg.norm(people[n][0].position_m - one.position_m)), n)
                        for n in people
                    ]
                    numbers[key] = min(near, default=(np.inf, 0))[1]
                    if not near or min(near)[0] > MERGED_M:
                        numbers[key] = len(numbers) + 1
                people.setdefault(numbers[key], []).append(one)
        merged.append(TimedTracks(time_ns, [_mean(n, group) for n, group in people.items()]))
    return merged


def _mean(number: int, group: Sequence[Track]) -> Track:
    position = np.mean([t.position_m for t in group], axis=0)
    return replace(group[0], id=number, position_m=position)
