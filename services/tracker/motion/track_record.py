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
    """Origin of the identity of a track, see `Track`; None where re-identification is off."""

    identity: Literal["new", "continued", "reidentified"] | None = None
    confidence: float | None = None  # 0 to 1
    reason: str = ""
    id: int | None = None  # of the person re-identified; None: the track keeps its own


@dataclass(frozen=True, slots=True)
class ImmState:
    """The state of one track under both motion models, standing and walking."""

    x: F64  # 2xn states
    P: F64  # 2xnxn, their covariances
    mode_probability: F64  # 2


@dataclass(slots=True)
class TrackRecord:
    """One track."""

    id: int
    x: F64  # state, see the motion model
    P: F64  # its covariance
    score: float  # of the last matched detection
    camera: str  # of the last match
    matched_ns: int  # [ns] stamp of the last match
    detection: int | None  # index of the detection matched in this frame
    confirmed: bool
    embedding: F64 | None = None
    identity: IdentityDecision = IdentityDecision()
    yaw: F64 | None = None  # state of its filter
    imm: ImmState | None = None  # states of both modes; x and P are their mean
    hits: int = 1  # frames matched, the first included
    streak: int = 1  # frames matched since the last miss
    age: int = 1  # frames since the first one, itself included
    begun_ns: int = 0  # [ns] stamp of the first match; 0: unknown
    missed_since_ns: int = 0  # [ns] stamp of the last match; of the frame after it, if much later
    missed: int = 0  # frames since the last match, this one included until it is matched
    hidden: int = 0  # of these, frames that could not show the person

    @property
    def frames_missed(self) -> int:
        """Frames since the last match that could have shown the person."""
        return self.missed - self.hidden


def stack(records: Sequence[TrackRecord]) -> tuple[F64, F64]:
    """Return the states (Nxn) and covariances (Nxnxn) of N tracks."""
    return np.array([t.x for t in records]), np.array([t.P for t in records])
