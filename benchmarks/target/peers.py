"""Identities of trackers of other packages on the same boxes, followed like a chosen person."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from benchmarks.lib.peers.run import PeerSequence, run_peers
from benchmarks.target.play import Choice, PlayedFrame, Rule
from common.geometry.boxes import iou_xyxy

PEERS = {"trackers ByteTrack": (0,), "BoxMOT BoT-SORT": (0,)}  # own settings of the packages
SAME_BOX = 0.5  # minimum overlap of the boxes of an identity and its detection

Identities = Mapping[int, int]  # identity by our track with the same detection


def peer_rules(pythons: Sequence[str], frames: Sequence[PlayedFrame]) -> dict[str, Rule]:
    """Return a rule for each tracker of the environments: the identity that was chosen."""
    boxes = [[d.box_xyxy_px for d in frame.detections.detections] for frame in frames]
    rows = [
        (number, *box.tolist(), d.score)
        for number, (frame, found) in enumerate(zip(frames, boxes, strict=True), 1)
        for d, box in zip(frame.detections.detections, found, strict=True)
    ]
    step_ns = np.median(np.diff([frame.truth.stamp_ns for frame in frames]))
    given = {"scene": PeerSequence(np.array(rows), len(frames), float(1e9 / step_ns))}
    rules = dict[str, Rule]()
    for python in pythons:
        for tracker, runs in run_peers(python, given, PEERS).items():
            found = defaultdict[int, dict[int, int]](dict)  # identities by frame and detection
            for number, identity, *corners in runs[0].rows["scene"].tolist():
                frame = int(number) - 1
                overlaps = iou_xyxy(np.array(corners), boxes[frame])[0] if boxes[frame] else [0.0]
                if max(overlaps) >= SAME_BOX:
                    found[frame][int(np.argmax(overlaps))] = int(identity)
            rules[f"identity of {tracker}"] = _by_identity(
                [
                    {
                        t.id: found[k][t.detection]
                        for t in frame.tracks.tracks
                        if t.detection is not None and t.detection in found[k]
                    }
                    for k, frame in enumerate(frames)
                ]
            )
    return rules


def _by_identity(identities: Sequence[Identities]) -> Rule:
    """Return the rule that follows the first identity of the chosen track."""

    def rule(frames: Sequence[PlayedFrame], choice: Choice) -> Iterator[int | None]:
        chosen = None
        for index in range(choice.frame - 1, len(frames)):
            now = identities[index]
            chosen = now.get(choice.track) if chosen is None else chosen
            if index >= choice.frame:
                yield next((track for track, one in now.items() if one == chosen), None)

    return rule
