"""Embeddings of tracks: cosine distances and their exponential moving average."""

from collections.abc import Sequence

import numpy as np

from people4d.messages import F64
from services.tracker.interface import Measurement, Observation
from services.tracker.motion.track_record import TrackRecord
from services.tracker.sort3d import association
from services.tracker.strongsort3d.policies import ContactPolicy, FrameContext, Match


def cosine_distances(records: Sequence[TrackRecord], detections: Sequence[Measurement]) -> F64:
    """Return the cosine distance (NxM) of tracks and detections, NaN where one is unknown."""
    return association.cosine_distances(
        [t.embedding for t in records], [m.embedding for m in detections]
    )


def embedder_of(observation: Observation) -> tuple[str, int] | None:
    """Return name and length of a frame's embeddings; None if there are none.

    Raises:
        ValueError: The lengths differ.
    """
    lengths = {len(m.embedding) for m in observation.measurements if m.embedding is not None}
    if len(lengths) > 1:
        raise ValueError(f"embeddings: expected one length, got {lengths}")
    return (observation.embedder, lengths.pop()) if lengths else None


def update_embeddings(
    matches: Sequence[Match], frame: FrameContext, contact: ContactPolicy
) -> None:
    """Update the embeddings of matched tracks: e <- alpha e + (1 - alpha) f."""
    for match in matches:
        record, measurement = match
        if measurement.embedding is not None and contact.updates_embedding(match, frame):
            alpha = contact.alpha(frame.config.ema_alpha, record)
            record.embedding = moving_average(record.embedding, measurement.embedding, alpha)


def moving_average(e: F64 | None, f: F64, alpha: float) -> F64:
    """Return alpha e + (1 - alpha) f at unit length; f if e is unknown or the sum vanishes."""
    mixed = f if e is None else alpha * e + (1 - alpha) * f
    length = float(np.linalg.norm(mixed))
    return mixed / length if length > 1e-6 else f
