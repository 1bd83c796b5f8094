"""Rectangles that cover heads, including frames between detections."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from common.geometry.boxes import iou_xyxy
from people4d.messages import F32, F64

FACE = slice(0, 5)  # COCO: nose, eyes, ears
SHOULDERS = slice(5, 7)
CONFIDENT = 0.1  # minimum confidence of a keypoint that widens the cover
HEADS_TALL = 6.0  # height of a person [heads], below the usual 7.5 for a larger cover
SHOULDER_SHARE = 0.6  # size of a head, relative to the distance of the shoulders
SIDE, ABOVE, BELOW = 0.8, 0.4, 1.2  # margins of the cover, in sizes of a head
LINK_IOU = 0.2  # minimum overlap of boxes of one person in successive frames
GAP_S = 2.0  # [s] maximum gap over which the cover is interpolated
HOLD_S = 0.5  # [s] duration of the cover before the first detection and after the last
GROWTH = 0.5  # growth of the cover's sides within HOLD_S


@dataclass(frozen=True, slots=True)
class Cover:
    """Cover of a head in one frame."""

    box_xyxy_px: F64  # 4, box of the person
    head_xyxy_px: F64  # 4, blacked out rectangle


def cover_of(box_xyxy_px: F32, keypoints: F32 | None) -> Cover:
    """Return the cover of a detected person's head.

    The rectangle holds the keypoints of the face and the middle of the box's upper edge, each with
    a margin in sizes of the head, which is the largest of several estimates.

    Args:
        box_xyxy_px: 4, left, top, right, bottom.
        keypoints: 17x3, u, v, confidence, COCO order; None if there are none.
    """
    left, top, right, bottom = (float(x) for x in box_xyxy_px)
    box = np.array([left, top, right, bottom])
    size = max((bottom - top) / HEADS_TALL, (right - left) / 4, 4.0)
    points = np.zeros((0, 2), np.float32)
    if keypoints is not None:
        face = keypoints[FACE][keypoints[FACE, 2] >= CONFIDENT, :2]
        shoulders = keypoints[SHOULDERS][keypoints[SHOULDERS, 2] >= CONFIDENT, :2]
        if len(face):
            size = max(size, float(np.ptp(face, axis=0).max()))
        if len(shoulders) == 2:
            size = max(size, SHOULDER_SHARE * float(np.linalg.norm(shoulders[1] - shoulders[0])))
        points = face if len(face) else shoulders
    if not len(points):  # upper part of the box, for people without keypoints
        head = np.array([left - size / 4, top - ABOVE * size, right + size / 4, top + 2 * size])
        return Cover(box, head)
    crown = np.array([[float(points[:, 0].mean()), top]])
    held = np.vstack([points, crown])
    low, high = held.min(axis=0), held.max(axis=0)
    head = np.array(
        [
            low[0] - SIDE * size,
            min(low[1] - ABOVE * size, top - ABOVE * size / 2),
            high[0] + SIDE * size,
            max(float(points[:, 1].max()) + ABOVE * size, top + BELOW * size),
        ]
    )
    return Cover(box, head)


Tracklet: TypeAlias = dict[int, Cover]  # covers of one person by index of the frame


def cover_frames(detected: Sequence[Sequence[Cover]], times_s: Sequence[float]) -> list[list[F64]]:
    """Return the rectangles that cover heads in each frame of a camera.

    Boxes that overlap from frame to frame are one person. The cover is interpolated between
    detections; before the first and after the last one it stays and grows.

    Args:
        detected: Covers of the detections, by frame.
        times_s: [s] time of each frame.

    Returns:
        Rectangles (4, xyxy) by frame.
    """
    rectangles = [[cover.head_xyxy_px for cover in covers] for covers in detected]
    for tracklet in _link(detected, times_s):
        frames = sorted(tracklet)
        for before, after in pairwise(frames):
            for k in range(before + 1, after):
                share = (times_s[k] - times_s[before]) / (times_s[after] - times_s[before])
                ends = tracklet[before].head_xyxy_px, tracklet[after].head_xyxy_px
                rectangles[k].append(_grown((1 - share) * ends[0] + share * ends[1], 0.25))
        for end, step in ((frames[0], -1), (frames[-1], 1)):
            k = end + step
            while 0 <= k < len(times_s) and abs(times_s[k] - times_s[end]) <= HOLD_S:
                share = abs(times_s[k] - times_s[end]) / HOLD_S
                rectangles[k].append(_grown(tracklet[end].head_xyxy_px, GROWTH * share))
                k += step
    return rectangles


def _link(detected: Sequence[Sequence[Cover]], times_s: Sequence[float]) -> list[Tracklet]:
    """Link the covers of each frame to the tracklet whose last box overlaps most."""
    done: list[Tracklet] = []
    open_ones: list[Tracklet] = []
    for k, covers in enumerate(detected):
        done += [t for t in open_ones if times_s[k] - times_s[max(t)] > GAP_S]
        open_ones = [t for t in open_ones if times_s[k] - times_s[max(t)] <= GAP_S]
        if not covers:
            continue
        boxes = np.array([cover.box_xyxy_px for cover in covers])
        free = set(range(len(covers)))
        for tracklet in sorted(open_ones, key=lambda t: -max(t)):
            last = tracklet[max(tracklet)].box_xyxy_px
            overlap = iou_xyxy(last[None], boxes)[0]
            best = max(free, key=lambda j: overlap[j], default=None)
            if best is not None and overlap[best] >= LINK_IOU:
                tracklet[k] = covers[best]
                free.remove(best)
        open_ones += [{k: covers[j]} for j in sorted(free)]
    return done + open_ones


def _grown(rectangle: F64, share: float) -> F64:
    """Return a rectangle enlarged by a share of its sides, half of it on each side."""
    sides = np.tile(rectangle[2:] - rectangle[:2], 2) / 2
    grown: F64 = rectangle + np.array([-1, -1, 1, 1]) * share * sides
    return grown
