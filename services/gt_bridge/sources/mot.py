"""Truth from MOT text: frame, id, box, flag and, in the 3D benchmarks, x, y, z in metres."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from common.metrics.mot_text import read_info, read_rows
from people4d.errors import DecodeError, SourceError
from people4d.messages import Truth, TruthPerson
from services.gt_bridge.config import GtBridgeConfig

MAX_FRAMES = 10**7  # 90 hours at 30 Hz: each is a message, also without people
RATES_HZ = (1e-3, 1e6)


class MotTruth:
    """The lines to be evaluated that have a position; frame 1 is at 0 s.

    Boxes are not used: they say where people are in the image, not how far away.

    Raises:
        SourceError: The file cannot be read, has no position, or its rate is not known.
    """

    def __init__(self, config: GtBridgeConfig) -> None:
        path = Path(config.truth)
        try:
            rows = read_rows(path).evaluated()
            rate_hz = config.rate_hz or _rate_hz(path)
        except DecodeError as error:
            raise SourceError(f"truth {error.problem}", error.hint) from error
        if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
            raise SourceError(f"truth {path} is of {rate_hz} Hz", "Set rate_hz.")
        if len(rows.frames) and rows.frames[-1] > MAX_FRAMES:
            raise SourceError(f"truth {path} has a frame {rows.frames[-1]}, beyond {MAX_FRAMES}")
        self._period_s = 1.0 / rate_hz
        self._rows = rows
        self._known = np.isfinite(rows.positions_m).all(axis=1) & (rows.ids >= 0)
        if not self._known.any():
            raise SourceError(
                f"truth {path} has no position of a person, only boxes in the image",
                "Columns 8 to 10 must be x, y, z in metres, as in the 3D benchmarks of MOT.",
            )

    def __iter__(self) -> Iterator[Truth]:
        """Yield one message for each frame up to the last, empty ones too."""
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
    """Read the rate from seqinfo.ini beside the file, or beside its folder as in gt/gt.txt."""
    for folder in (path.parent, path.parent.parent):
        if (folder / "seqinfo.ini").is_file():
            return read_info(folder / "seqinfo.ini").rate_hz
    raise SourceError(
        f"truth {path} has no seqinfo.ini beside it, so its rate is not known", "Set rate_hz."
    )
