"""Truth from arrays in an NPZ file (gt.npz)."""

import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from common.errors import SourceError
from common.messages import F64, Truth, TruthPerson
from services.gt_bridge.config import GtBridgeConfig

AXES = {"t": 1, "pos": 3, "vel": 3, "yaw": 2}  # arrays needed: N, NxKx3, NxKx3, NxK
MAX_BYTES = 256 * 2**20  # of one array


class NpzTruth:
    """K people at N times: ids "0" to K-1.

    Raises:
        SourceError: The file is absent, is no NPZ, or lacks an array.
    """

    def __init__(self, config: GtBridgeConfig) -> None:
        path = Path(config.truth)
        path = path / "gt.npz" if path.is_dir() else path
        try:
            with np.load(path, allow_pickle=False) as file:
                self._arrays = {name: self._read(file, name) for name in AXES}
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise SourceError(
                f"truth {path} cannot be read: {error}",
                f"Expected an NPZ file with the arrays {', '.join(AXES)}.",
            ) from error

    @staticmethod
    def _read(file: np.lib.npyio.NpzFile, name: str) -> F64:
        if file.zip is None or file.zip.getinfo(f"{name}.npy").file_size > MAX_BYTES:
            raise ValueError(f"array {name} is larger than {MAX_BYTES} bytes")
        array = np.asarray(file[name], np.float64)
        if array.ndim != AXES[name] or not np.all(np.isfinite(array)):
            raise ValueError(f"array {name} has another form or is not finite")
        return array

    def __iter__(self) -> Iterator[Truth]:
        """Yield one message for each time."""
        times, *people = (self._arrays[name] for name in AXES)
        for row, (t, pos, vel, yaw) in enumerate(zip(times, *people, strict=False)):
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
