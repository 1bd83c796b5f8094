"""People of one frame: tracks joined with detections and embeddings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.geometry.boxes import intersections_xyxy
from people4d.messages import F64, Detection, Detections, Embeddings, Track, Tracks

OVERLAP_MAX = 0.3  # maximum share of the box of an uncovered crop inside the box of a nearer person
EDGE_SHARE = 0.02  # minimum distance of a whole crop from the sides of the image, of its width


@dataclass(frozen=True)
class TargetCandidate:
    """One track of a frame."""

    track: Track
    embedding: F64 | None  # embedding of the crop; None without a crop, or if it is covered
    is_cut: bool = False  # True: the crop touches a side of the image

    @property
    def id(self) -> int:
        """Identity of the track."""
        return self.track.id

    @property
    def height_m(self) -> float:
        """Height of the torso in the frame of the tracks [m]."""
        return float(self.track.position_m[2])


@dataclass(frozen=True)
class TargetFrame:
    """All people of a frame."""

    stamp_ns: int
    frame_id: str
    people: tuple[TargetCandidate, ...]
    embedder: tuple[str, int] | None  # name and length of the embeddings; None without any
    robot_m: F64 | None = None  # [m] x, y of the robot's base; None if unknown
    raised: frozenset[int] | None = None  # tracks with a raised hand; None without skeletons


def observe_people(
    tracks: Tracks,
    detections: Detections | None,
    embeddings: Embeddings | None,
    robot_m: F64 | None,
    raised: frozenset[int] | None = None,
) -> TargetFrame:
    """Join the tracks of a frame with their crops; each track once, no tentative ones."""
    found = {t.id: t for t in tracks.tracks if t.state != "tentative"}
    crops, embedder = dict[int | None, tuple[F64, bool]](), None
    if detections and embeddings:
        rows = dict(zip(embeddings.detections, embeddings.vectors, strict=True))
        for i in uncovered_crops(detections.detections):
            if i in rows:
                is_cut = touches_side(detections.detections[i], detections.width)
                crops[i] = rows[i].astype(np.float64), is_cut
        embedder = embeddings.model, embeddings.vectors.shape[1]
    people = tuple(
        TargetCandidate(t, *crops.get(t.detection, (None, False))) for t in found.values()
    )
    return TargetFrame(tracks.stamp_ns, tracks.frame_id, people, embedder, robot_m, raised)


def touches_side(detection: Detection, width: int) -> bool:
    """Check that a box touches the left or right side of the image."""
    left, _, right, _ = detection.box_xyxy_px.tolist()
    return bool(min(left, width - right) < EDGE_SHARE * width)


def uncovered_crops(detections: Sequence[Detection]) -> list[int]:
    """Return the detections that no nearer one covers."""
    if not detections:
        return []
    boxes = np.array([d.box_xyxy_px for d in detections], np.float64)
    left, top, right, bottom = boxes.T
    depths_m = np.array([np.nan if d.position_m is None else d.position_m[2] for d in detections])
    is_behind = depths_m[:, None] < depths_m
    common = np.where(is_behind, 0.0, intersections_xyxy(boxes, boxes))
    np.fill_diagonal(common, 0.0)
    area = np.maximum((right - left) * (bottom - top), 1e-9)
    return [int(i) for i in np.flatnonzero(common.max(axis=1) <= OVERLAP_MAX * area)]
