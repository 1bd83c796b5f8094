"""The state of one track."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from people4d.messages import F64

BOOL = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class IdentityDecision:
    """Origin of the identity of a track, see `Track`; None if re-identification is off."""

    identity: Literal["new", "continued", "reidentified"] | None = None
    confidence: float | None = None  # 0 to 1
    reason: str = ""


@dataclass(frozen=True, slots=True)
class ImmState:
    """The state of one track under both motion models, standing and walking."""

    x: F64  # 2xn, states of both modes
    P: F64  # 2xnxn, covariances of x
    mode_probability: F64  # 2


@dataclass(slots=True)
class TrackRecord:
    """A track: its states, appearance, last match and counts."""

    id: int
    x: F64  # state, see the motion model
    P: F64  # covariance of x
    score: float  # score of the last matched detection
    camera: str  # camera of the last match
    matched_ns: int  # [ns] stamp of the last match
    detection: int | None  # index of the detection matched in this frame
    confirmed: bool
    embedding: F64 | None = None
    identity: IdentityDecision = IdentityDecision()
    yaw: F64 | None = None  # state of the yaw filter
    imm: ImmState | None = None  # states of both modes; x and P are their mean
    person_log_odds: float = 0.0  # mean log-odds of a person over the matches
    hits: int = 1  # number of matched frames
    streak: int = 1  # number of matched frames since the last miss
    age: int = 1  # number of frames since the beginning, including the first
    begun_ns: int = 0  # [ns] stamp of the first match; 0: unknown
    missed_since_ns: int = 0  # [ns] stamp of the last match, or shortly before the next frame
    missed: int = 0  # number of frames since the last match
    hidden: int = 0  # number of missed frames in which the person was hidden

    @property
    def frames_missed(self) -> int:
        """Number of missed frames in which the person was not hidden."""
        return self.missed - self.hidden


def stack(records: Sequence[TrackRecord]) -> tuple[F64, F64]:
    """Return the states (Nxn) and covariances (Nxnxn) of N tracks."""
    return np.array([t.x for t in records]), np.array([t.P for t in records])
