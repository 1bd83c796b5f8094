"""Truth from arrays in an NPZ file (gt.npz)."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from common.io.npz import read_arrays
from people4d.codec import MAX_ITEMS
from people4d.errors import SourceError
from people4d.messages import F64, Truth, TruthPerson
from services.gt_bridge.config import GtBridgeConfig

AXES = ("t", "pos", "vel", "yaw")  # arrays needed: N, NxKx3, NxKx3, NxK
MAX_TIME_S = 2**33  # [s] the year 2242; beyond it nanoseconds do not fit 64 bits


class NpzTruth:
    """K people at N times: ids "0" to K-1.

    Raises:
        SourceError: The file is absent, is no NPZ, or lacks an array.
    """

    def __init__(self, config: GtBridgeConfig) -> None:
        path = Path(config.truth)
        path = path / "gt.npz" if path.is_dir() else path
        try:
            arrays = read_arrays(path, AXES)
            self._arrays = [np.asarray(arrays[name], np.float64) for name in AXES]
            _check(*self._arrays)
        except (OSError, ValueError) as error:
            raise SourceError(
                f"truth {path} cannot be read: {error}",
                f"Expected an NPZ file with the arrays {', '.join(AXES)}.",
            ) from error

    def __iter__(self) -> Iterator[Truth]:
        """Yield one message for each time."""
        for row, (t, pos, vel, yaw) in enumerate(zip(*self._arrays, strict=True)):
            yield Truth(
                stamp_ns=round(float(t) * 1e9),
                sequence=row,
                frame_id="map",
                people=tuple(
                    TruthPerson(
                        id=str(k), position_m=pos[k], velocity_mps=vel[k], yaw_rad=float(yaw[k])
                    )
                    for k in range(len(pos))
                ),
            )


def _check(t: F64, pos: F64, vel: F64, yaw: F64) -> None:
    shapes = [array.shape for array in (t, pos, vel, yaw)]
    count, people = yaw.shape if yaw.ndim == 2 else (0, 0)
    if shapes != [(count,), (count, people, 3), (count, people, 3), (count, people)]:
        raise ValueError(f"expected arrays of N, NxKx3, NxKx3 and NxK, got {shapes}")
    if people > MAX_ITEMS:
        raise ValueError(f"expected at most {MAX_ITEMS} people, got {people}")
    if not all(np.all(np.isfinite(array)) for array in (t, pos, vel, yaw)):
        raise ValueError("expected finite numbers, got NaN or infinity")
    if np.any(np.abs(t) > MAX_TIME_S):
        raise ValueError(f"expected times of at most {MAX_TIME_S} s")
