"""Truth from recordings, arrays in an NPZ file, and MOT text."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from common.io.npz import read_arrays
from common.io.recording import open_recording
from common.metrics.mot_text import read_info, read_rows
from people4d.codec import MAX_ITEMS
from people4d.errors import DecodeError, SourceError
from people4d.messages import F64, Truth, TruthPerson
from people4d.messages.base import MAX_M
from services.gt_bridge.config import GtBridgeConfig

AXES = ("t", "pos", "vel", "yaw")  # required arrays: N, NxKx3, NxKx3, NxK
MAX_TIME_S = 2**33  # maximum time, in the year 2242, whose nanoseconds fit 64 bits [s]
MAX_FRAMES = 10**7  # maximum number of frames, 90 hours at 30 Hz
RATES_HZ = (1e-3, 1e6)  # range of frame rates


class RecordingTruth:
    """Truth messages of a recording; SourceError if it is no recording, or holds no truth."""

    def __init__(self, config: GtBridgeConfig) -> None:
        self._recording = open_recording(Path(config.truth))
        if not any(True for _ in self):
            topics = ", ".join(self._recording.summary.topics) or "nothing"
            raise SourceError(f"truth {config.truth} holds no truth", f"It holds {topics}.")

    def __iter__(self) -> Iterator[Truth]:
        """Yield the messages in the order of the recording."""
        for _, message in self._recording.messages(Truth):
            if isinstance(message, Truth):
                yield message


class NpzTruth:
    """K people at N times, with ids "0" to K-1, except positions of NaN.

    SourceError if the file does not exist, is not NPZ, or lacks an array.
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
                        id=str(k),
                        position_m=pos[k],
                        velocity_mps=vel[k] if np.isfinite(vel[k]).all() else None,
                        yaw_rad=float(yaw[k]) if np.isfinite(yaw[k]) else None,
                    )
                    for k in range(len(pos))
                    if not np.isnan(pos[k]).any()
                ),
            )


def _check(t: F64, pos: F64, vel: F64, yaw: F64) -> None:
    shapes = [array.shape for array in (t, pos, vel, yaw)]
    count, people = yaw.shape if yaw.ndim == 2 else (0, 0)
    if shapes != [(count,), (count, people, 3), (count, people, 3), (count, people)]:
        raise ValueError(f"expected arrays of N, NxKx3, NxKx3 and NxK, got {shapes}")
    if people > MAX_ITEMS:
        raise ValueError(f"expected at most {MAX_ITEMS} people, got {people}")
    if not np.all(np.abs(t) <= MAX_TIME_S):
        raise ValueError(f"expected times of at most {MAX_TIME_S} s")


class MotTruth:
    """Evaluated lines with a position; frame 1 is at 0 s. Boxes are not used.

    SourceError if the file cannot be read, has no position, or its rate is unknown.
    """

    def __init__(self, config: GtBridgeConfig) -> None:
        path = Path(config.truth)
        try:
            rows = read_rows(path).evaluated()
            rate_hz = config.rate_hz or _rate_hz(path)
        except DecodeError as error:
            raise SourceError(f"truth {error.problem}", error.hint) from error
        if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
            raise SourceError(f"truth {path} has a rate of {rate_hz} Hz", "Set rate_hz.")
        if len(rows.frames) and rows.frames[-1] > MAX_FRAMES:
            raise SourceError(f"truth {path} has a frame {rows.frames[-1]}, beyond {MAX_FRAMES}")
        self._period_s = 1.0 / rate_hz
        self._rows = rows
        self._known = np.isfinite(rows.positions_m).all(axis=1) & (rows.ids >= 0)
        if (np.abs(rows.positions_m[self._known]) > MAX_M).any():
            raise SourceError(f"truth {path} has a position beyond {MAX_M:g} m")
        if not self._known.any():
            raise SourceError(
                f"truth {path} has no position of a person, only boxes in the image",
                "Columns 8 to 10 must be x, y, z in metres, as in the 3D benchmarks of MOT; class "
                "and visibility are not positions.",
            )

    def __iter__(self) -> Iterator[Truth]:
        """Yield one message for each frame up to the last, also for empty frames."""
        for number in range(1, int(self._rows.frames[-1]) + 1):
            start, end = np.searchsorted(self._rows.frames, [number, number + 1])
            yield Truth(
                stamp_ns=round((number - 1) * self._period_s * 1e9),
                sequence=number - 1,
                frame_id="map",
                people=tuple(
                    TruthPerson(id=str(self._rows.ids[row]), position_m=self._rows.positions_m[row])
                    for row in range(start, end)
                    if self._known[row]
                ),
            )


def _rate_hz(path: Path) -> float:
    """Read the frame rate from seqinfo.ini in the folder of the file, or in its parent folder."""
    for folder in (path.parent, path.parent.parent):
        if (folder / "seqinfo.ini").is_file():
            return read_info(folder / "seqinfo.ini").rate_hz
    raise SourceError(f"truth {path} has no seqinfo.ini, so its rate is not known", "Set rate_hz.")
