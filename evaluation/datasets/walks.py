"""Recorded paths of pedestrians as tracks: ETH walking pedestrians and UCY crowds by example."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from people4d.errors import SourceError
from people4d.messages import F64, PersonPrediction, Predictions, Track, Tracks
from services.predictor.build import build
from services.predictor.config import PredictorConfig

PERIOD_S = 0.4  # [s] interval of annotations
UNKNOWN = 1e5  # [m^2/s^2] variance of an unknown velocity


@dataclass(frozen=True)
class Walks:
    """Annotated positions of people, K in all, ordered by time."""

    name: str
    times_s: F64  # K
    ids: npt.NDArray[np.int64]  # K
    positions_m: F64  # Kx2
    groups: frozenset[frozenset[int]]  # pairs of people in one group

    def frames(self) -> Iterator[npt.NDArray[np.int64]]:
        """Yield the rows of each time."""
        _, starts = np.unique(self.times_s, return_index=True)
        yield from np.split(np.arange(len(self.ids)), starts[1:])

    def tracks(self, rows: npt.NDArray[np.int64]) -> Tracks:
        """Return the people of a time as tracks: positions without velocities."""
        covariance = np.diag([1e-6] * 3 + [UNKNOWN] * 3)
        people = tuple(
            Track(
                id=int(self.ids[row]),
                state="confirmed",
                position_m=np.append(self.positions_m[row], 0.0),
                velocity_mps=np.zeros(3),
                covariance=covariance,
                yaw_rad=None,
                hits=1,
                age=1,
                time_since_update_s=0.0,
                detection=None,
                score=1.0,
            )
            for row in rows
        )
        return Tracks(
            stamp_ns=round(float(self.times_s[rows[0]]) * 1e9),
            sequence=0,
            frame_id="map",
            camera="above",
            tracker="annotation",
            tracks=people,
        )

    def history(self) -> npt.NDArray[np.int64]:
        """Return the number of annotations of the same person up to each row, K."""
        counts: Counter[int] = Counter()
        found = np.zeros(len(self.ids), np.int64)
        for row, person in enumerate(self.ids.tolist()):
            counts[person] += 1
            found[row] = counts[person]
        return found

    def followed(self, horizons_s: F64) -> tuple[F64, F64]:
        """Return true positions (KxHx2, NaN where unknown) and last velocities (Kx2) by rows.

        A velocity is the mean since the previous annotation, NaN at the first one of a person.
        """
        truth_m = np.full((len(self.ids), len(horizons_s), 2), np.nan)
        velocities_mps = np.full((len(self.ids), 2), np.nan)
        for person in np.unique(self.ids):
            rows = np.flatnonzero(self.ids == person)
            times_s, path_m = self.times_s[rows], self.positions_m[rows]
            steps_s = np.diff(times_s)[:, None]
            velocities_mps[rows[1:]] = np.diff(path_m, axis=0) / steps_s
            wanted_s = times_s[:, None] + horizons_s
            known = wanted_s <= times_s[-1] + 1e-6
            for axis in (0, 1):
                found = np.interp(wanted_s, times_s, path_m[:, axis])
                truth_m[rows, :, axis] = np.where(known, found, np.nan)
        return truth_m, velocities_mps


@dataclass(frozen=True)
class PredictedWalks:
    """Predictions on annotated paths."""

    horizons_s: F64  # H
    people: dict[int, PersonPrediction]  # predictions by row of the walks
    messages: list[Predictions]


def predict(walks: Walks, config: PredictorConfig) -> PredictedWalks:
    """Predict all people at each time."""
    node = build(config)
    messages: list[Predictions] = []
    people: dict[int, PersonPrediction] = {}
    for rows in walks.frames():
        for message in node.handle(walks.tracks(rows), 0):
            assert isinstance(message, Predictions)
            messages.append(message)
            people |= dict(zip(rows.tolist(), message.people, strict=True))
    horizons_s = messages[-1].horizons_s if messages else ()
    return PredictedWalks(np.array(horizons_s), people, messages)


def read_walks(folder: Path) -> Walks:
    """Read `obsmat.txt` and `groups.txt` of a scene; SourceError if one is absent or malformed."""
    try:
        table = np.loadtxt(folder / "obsmat.txt", ndmin=2)
        lines = (folder / "groups.txt").read_text(encoding="utf-8").splitlines()
        members = [[int(word) for word in line.split()] for line in lines]
    except (OSError, ValueError) as error:
        raise SourceError(f"{folder} holds no paths of pedestrians: {error}") from error
    if table.shape[1] != 8 or not np.isfinite(table).all():
        raise SourceError(f"{folder}/obsmat.txt: expected 8 finite columns, got {table.shape[1]}")
    table = table[np.lexsort((table[:, 1], table[:, 0]))]
    numbers = np.unique(table[:, 0])
    if len(numbers) < 2:
        raise SourceError(f"{folder}/obsmat.txt: expected two or more frames, got {len(numbers)}")
    steps, counts = np.unique(np.diff(numbers), return_counts=True)
    step = steps[counts.argmax()]  # frames between two annotations
    pairs = (frozenset((a, b)) for group in members for a in group for b in group if a < b)
    return Walks(
        name=folder.name,
        times_s=table[:, 0] / step * PERIOD_S,
        ids=table[:, 1].astype(np.int64),
        positions_m=table[:, [2, 4]],
        groups=frozenset(pairs),
    )
