"""Inputs of the parity tests: a simple tracker on the MOT15 detections, and drawn sequences."""

from pathlib import Path

import numpy as np

from common.geometry.boxes import iou_xyxy
from common.metrics.mot_text import MotRows, read_info, read_rows, sequence
from common.metrics.record import EvaluationFrame, EvaluationSequence, GroundTruth, Hypotheses
from people4d.messages import F64

MOT15 = ("ADL-Rundle-6", "ETH-Bahnhof", "KITTI-17", "TUD-Campus", "TUD-Stadtmitte")
SEEDS = (0, 1, 2, 3)


def greedy_tracks(detections: MotRows, frames: int) -> dict[int, Hypotheses]:
    """Link each box to the box of the frame before that overlaps it most, from 0.3 up."""
    tracks: dict[int, Hypotheses] = {}
    ids, boxes, unused = np.zeros(0, np.int64), np.zeros((0, 4)), 1
    for number in range(1, frames + 1):
        found = detections.frame_rows(number).boxes_xyxy_px
        overlap, linked = iou_xyxy(boxes, found), np.zeros(len(found), np.int64)
        while overlap.size and overlap.max() >= 0.3:
            i, j = np.unravel_index(overlap.argmax(), overlap.shape)
            linked[j] = ids[i]
            overlap[i], overlap[:, j] = 0.0, 0.0
        for j in np.flatnonzero(linked == 0):
            linked[j], unused = unused, unused + 1
        ids, boxes = linked, found
        tracks[number] = Hypotheses(ids=tuple(ids.tolist()), boxes_xyxy_px=boxes)
    return tracks


def mot15(folder: Path) -> EvaluationSequence:
    """Put the ground truth of one MOT15 sequence and its greedy tracks together."""
    info = read_info(folder / "seqinfo.ini")
    tracks = greedy_tracks(read_rows(folder / "det" / "det.txt"), info.frames)
    return sequence(info, read_rows(folder / "gt" / "gt.txt"), tracks)


def drawn(seed: int) -> EvaluationSequence:
    """Draw five people in a crowd for 60 frames, with pauses, and an untidy tracker's tracks."""
    random = np.random.RandomState(seed)  # its draws never change, unlike a Generator's
    start_m, step_m = random.uniform(0, 1.2, (5, 3)), random.normal(0, 0.01, (5, 3))
    names = random.permutation(5) + 10
    frames = []
    for index in range(60):
        here = random.random_sample(5) < (0.0 if index % 20 == 7 else 0.9)
        if random.random_sample() < 0.1:  # a swap
            a, b = random.choice(5, 2, replace=False)
            names[[a, b]] = names[[b, a]]
        if random.random_sample() < 0.2:  # a new name
            names[random.randint(5)] = 100 + index
        found = random.random_sample(5) < (0.0 if index % 20 == 13 else 0.85)
        truth_m = start_m + index * step_m
        tracked_m = truth_m + random.normal(0, 0.25, (5, 3))
        frames.append(_drawn_frame(index, truth_m[here], tracked_m[found], (here, names[found])))
    return EvaluationSequence(f"drawn {seed}", tuple(frames))


def _drawn_frame(
    index: int, truth_m: F64, tracked_m: F64, who: tuple[np.ndarray, np.ndarray]
) -> EvaluationFrame:
    here, names = who
    return EvaluationFrame(
        stamp_ns=index * 40_000_000,
        truth=GroundTruth(ids=tuple(np.flatnonzero(here).tolist()), positions_m=truth_m),
        hypotheses=Hypotheses(ids=tuple(names.tolist()), positions_m=tracked_m),
    )
