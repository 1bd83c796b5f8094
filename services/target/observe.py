"""People of one frame: tracks joined with detections and embeddings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from people4d.messages import F64, Detection, Detections, Embeddings, Track, Tracks

OVERLAP_MAX = 0.3  # maximum share of the box of a clear crop inside the box of a nearer person
EDGE_SHARE = 0.02  # minimum distance of a clear crop from the sides of the image, of its width


@dataclass(frozen=True)
class TargetCandidate:
    """One track of a frame."""

    track: Track
    embedding: F64 | None  # embedding of the crop; None without a clear crop

    @property
    def id(self) -> int:
        """Identity of the track."""
        return self.track.id


@dataclass(frozen=True)
class TargetFrame:
    """All people of a frame."""

    stamp_ns: int
    frame_id: str
    people: tuple[TargetCandidate, ...]
    embedder: tuple[str, int] | None  # name and length of the embeddings; None without any
    robot_m: F64 | None = None  # [m] x, y of the robot's base; None if unknown


def observe_people(
    tracks: Tracks,
    detections: Detections | None,
    embeddings: Embeddings | None,
    robot_m: F64 | None,
) -> TargetFrame:
    """Join the tracks of a frame with its clear crops; each track once, no tentative ones."""
    found = {t.id: t for t in tracks.tracks if t.state != "tentative"}
    vectors, embedder = dict[int, F64](), None
    if detections and embeddings:
        rows = dict(zip(embeddings.detections, embeddings.vectors, strict=True))
        clear = clear_crops(detections.detections, detections.width)
        vectors = {i: rows[i].astype(np.float64) for i in clear if i in rows}
        embedder = embeddings.model, embeddings.vectors.shape[1]
    people = tuple(
        TargetCandidate(t, None if t.detection is None else vectors.get(t.detection))
        for t in found.values()
    )
    return TargetFrame(tracks.stamp_ns, tracks.frame_id, people, embedder, robot_m)


def clear_crops(detections: Sequence[Detection], width: int) -> list[int]:
    """Return the detections that no nearer one covers, and that touch no side of the image."""
    if not detections:
        return []
    boxes = np.array([d.box_xyxy_px for d in detections], np.float64)
    left, top, right, bottom = boxes.T
    across = np.minimum(right[:, None], right) - np.maximum(left[:, None], left)
    down = np.minimum(bottom[:, None], bottom) - np.maximum(top[:, None], top)
    depths_m = np.array([np.nan if d.position_m is None else d.position_m[2] for d in detections])
    is_behind = depths_m[:, None] < depths_m
    common = np.where(is_behind, 0.0, np.maximum(across, 0.0) * np.maximum(down, 0.0))
    np.fill_diagonal(common, 0.0)
    area = np.maximum((right - left) * (bottom - top), 1e-9)
    margin = EDGE_SHARE * width
    clear = common.max(axis=1) <= OVERLAP_MAX * area
    clear &= (left >= margin) & (right <= width - margin)
    return [int(i) for i in np.flatnonzero(clear)]
