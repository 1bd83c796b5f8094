"""Whom the cameras can see."""

from collections.abc import Sequence

import numpy as np

from common.geometry.transform_buffer import TransformBuffer
from common.metrics import in_view
from common.metrics.record import BOOL
from people4d.messages import F64, CameraInfo


class Views:
    """Where cameras are and how far they see.

    Args:
        frames: Transforms, which others add.
    """

    def __init__(self, frames: TransformBuffer) -> None:
        self._frames = frames
        self._infos: dict[str, CameraInfo] = {}

    def add(self, info: CameraInfo) -> None:
        """Take the calibration of a camera."""
        self._infos[info.camera] = info

    def outside(self, positions_m: Sequence[F64], frame_id: str, stamp_ns: int) -> BOOL | None:
        """Tell who is outside of the view of every camera.

        Args:
            positions_m: N of 3 coordinates.
            frame_id: Their frame.
            stamp_ns: When they were there; cameras may move.

        Returns:
            N; None if the place of no camera is known.
        """
        places = [
            (info, self._frames.lookup(info.frame_id, frame_id, stamp_ns))
            for info in self._infos.values()
        ]
        views = [
            in_view(np.array(positions_m), place.matrix, info)
            for info, place in places
            if place is not None
        ]
        return np.asarray(~np.any(views, axis=0)) if views else None
