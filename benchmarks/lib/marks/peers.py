"""Trackers of other packages on the boxes of an annotated recording."""

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.lib.marks.crossing import FPS
from benchmarks.lib.marks.methods import HALVES
from benchmarks.lib.marks.recording import FrameOutput, MarkedRecording
from benchmarks.lib.marks.scores import MarkScores, TrackedPerson, figures
from benchmarks.lib.peers.run import PeerRun, PeerSequence, run_peers
from common.geometry.boxes import iou_xyxy
from people4d.messages import F64

SAME_BOX = 0.5  # minimum overlap of the boxes of a track and its detection


def crossing_peers(
    python: str, recording: MarkedRecording, outputs: Sequence[FrameOutput]
) -> dict[str, dict[int, list[TrackedPerson]]]:
    """Return the tracks of each other package with its best settings."""
    rows = [
        (number, *map(float, d.box_xyxy_px), d.score)
        for number, one in enumerate(outputs, 1)
        for d in one.detections.detections
    ]
    sequence = PeerSequence(np.array(rows, np.float64), len(outputs), FPS)
    detected, found = (
        recording.detected(one.detections for one in outputs),
        dict[str, dict[int, list[TrackedPerson]]](),
    )

    def tuning_owned(tracks: Mapping[int, Sequence[TrackedPerson]]) -> int:
        outcomes = MarkScores(recording.truth, tracks, FPS).outcomes
        return figures([o for o in outcomes if o.frame in HALVES["first half"]]).owned.part

    for tracker, runs in run_peers(python, {"filinha": sequence}, {}).items():
        tracks = {number: people_of(one, detected) for number, one in runs.items()}
        best = max(tracks, key=lambda number: tuning_owned(tracks[number]))
        found[f"{tracker} {runs[best].words(best)}"] = tracks[best]
    return found


def people_of(
    one: PeerRun, detected: Mapping[int, Sequence[TrackedPerson]]
) -> dict[int, list[TrackedPerson]]:
    """Return the tracks of another package, frames from 0, with positions of detections."""
    tracks = dict[int, list[TrackedPerson]]()
    for number, identity, *corners in one.rows["filinha"].tolist():
        frame, box = int(number) - 1, np.array(corners)
        position_m = position_in(box, detected[frame])
        person = TrackedPerson(int(identity), box, detected_m=position_m)
        tracks.setdefault(frame, []).append(person)
    return tracks


def position_in(box_xyxy_px: F64, detected: Sequence[TrackedPerson]) -> F64 | None:
    """Return the position of the detection with the largest overlap of boxes; None if none."""
    if not detected:
        return None
    overlaps = iou_xyxy(box_xyxy_px, [one.box_xyxy_px for one in detected])[0]
    best = int(overlaps.argmax())
    return detected[best].position_m if overlaps[best] >= SAME_BOX else None
