"""Ground truth and hypotheses frame by frame: the input of all metrics."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from people4d.messages import F64
from people4d.messages.base import check_finite, check_shape

BOOL = npt.NDArray[np.bool_]
I64 = npt.NDArray[np.int64]
Id: TypeAlias = int | str


@dataclass(frozen=True, kw_only=True)
class PeopleColumns:
    """The people of one frame, one row each; a quantity that is unknown for all is absent."""

    ids: tuple[Id, ...] = ()  # identities, each at most once
    boxes_xyxy_px: F64 | None = None  # [px] Nx4: left, top, right, bottom
    positions_m: F64 | None = None  # [m] Nx3, z up, in the same frame for truth and hypotheses
    velocities_mps: F64 | None = None  # [m/s] Nx3 in the frame of positions_m; NaN if unknown
    yaws_rad: F64 | None = None  # [rad] N, 0 = +x, counter-clockwise; NaN where unknown

    def __post_init__(self) -> None:
        """Check that the columns belong together, and boxes and positions are finite."""
        n = len(self.ids)
        if len(set(self.ids)) < n:
            raise ValueError(f"ids: expected each at most once in a frame, got {self.ids}")
        check_shape("boxes_xyxy_px", self.boxes_xyxy_px, (n, 4))
        check_shape("positions_m", self.positions_m, (n, 3))
        check_shape("velocities_mps", self.velocities_mps, (n, 3))
        check_shape("yaws_rad", self.yaws_rad, (n,))
        check_finite("boxes_xyxy_px", self.boxes_xyxy_px)
        check_finite("positions_m", self.positions_m)


@dataclass(frozen=True, kw_only=True)
class GroundTruth(PeopleColumns):
    """True people of one frame.

    A person out of view or occluded is neither miss nor match, and a track matched to this person
    is no false alarm. Errors on occluded people are collected separately.
    """

    out_of_view: BOOL | None = None  # N: outside the image or depth range; absent: unknown
    occluded: BOOL | None = None  # N: in view but occluded; absent: none

    def __post_init__(self) -> None:
        """Check the masks, too."""
        super().__post_init__()
        check_shape("out_of_view", self.out_of_view, (len(self.ids),))
        check_shape("occluded", self.occluded, (len(self.ids),))

    @property
    def in_view(self) -> BOOL:
        """Mask (N) of the people in the view, occluded or not."""
        return ~_mask(self.out_of_view, len(self.ids))

    @property
    def required(self) -> BOOL:
        """Mask (N) of the people to be tracked: in view and not occluded."""
        return self.in_view & ~_mask(self.occluded, len(self.ids))


@dataclass(frozen=True, kw_only=True)
class Hypotheses(PeopleColumns):
    """The people that a tracker reports."""

    predicted: BOOL | None = None  # N: reported without a measurement in this frame; absent: none

    def __post_init__(self) -> None:
        """Check the mask, too."""
        super().__post_init__()
        check_shape("predicted", self.predicted, (len(self.ids),))

    @property
    def was_predicted(self) -> BOOL:
        """Mask (N) of the tracks without a measurement in this frame."""
        return _mask(self.predicted, len(self.ids))


@dataclass(frozen=True, kw_only=True)
class EvaluationFrame:
    """Ground truth and hypotheses at one stamp."""

    stamp_ns: int  # [ns] acquisition time
    truth: GroundTruth = GroundTruth()
    hypotheses: Hypotheses = Hypotheses()
    map_from_camera: F64 | None = None  # 4x4, map from optical frame; absent: no camera axis

    def __post_init__(self) -> None:
        """Check the camera's pose."""
        check_shape("map_from_camera", self.map_from_camera, (4, 4))
        check_finite("map_from_camera", self.map_from_camera)


@dataclass(frozen=True)
class FrameMatches:
    """People and tracks of one frame by number, and the matched pairs."""

    persons: I64  # N, index into Matching.persons
    tracks: I64  # M, index into Matching.tracks
    required: BOOL  # N, people to be tracked
    similarity: F64  # NxM
    rows: I64  # K, index into persons of each pair
    columns: I64  # K, index into tracks of each pair

    @cached_property
    def evaluated_tracks(self) -> BOOL:
        """Mask (M) of evaluated tracks: all except matches of people not to be tracked."""
        mask = np.ones(len(self.tracks), np.bool_)
        mask[self.columns[~self.required_pairs]] = False
        return mask

    @cached_property
    def evaluated(self) -> tuple[I64, I64, F64]:
        """Evaluated persons and tracks, and their similarity."""
        similarity = self.similarity[np.ix_(self.required, self.evaluated_tracks)]
        return self.persons[self.required], self.tracks[self.evaluated_tracks], similarity

    @property
    def required_pairs(self) -> BOOL:
        """Pairs (K) of people to be tracked."""
        return self.required[self.rows]


@dataclass(frozen=True)
class EvaluationSequence:
    """One recording, frame by frame."""

    name: str
    frames: tuple[EvaluationFrame, ...]

    def __post_init__(self) -> None:
        """Check that each frame is later than the previous one."""
        for before, after in pairwise(self.frames):
            if after.stamp_ns <= before.stamp_ns:
                raise ValueError(
                    f"frames of {self.name}: expected rising stamps, "
                    f"got {after.stamp_ns} after {before.stamp_ns}"
                )

    @cached_property
    def stamps_s(self) -> F64:
        """Times of frames since the first [s]."""
        start_ns = self.frames[0].stamp_ns if self.frames else 0
        return np.array([(frame.stamp_ns - start_ns) / 1e9 for frame in self.frames])

    @cached_property
    def periods_s(self) -> F64:
        """Time [s] from each frame to the next; for the last one their median.

        Their sum is the duration: 1800 frames at 30 Hz are one minute. One frame lasts 0 s.
        """
        until_next = np.diff(self.stamps_s)
        last = float(np.median(until_next)) if len(until_next) else 0.0
        return np.append(until_next, last)[: len(self.frames)]


def _mask(mask: BOOL | None, n: int) -> BOOL:
    return np.zeros(n, np.bool_) if mask is None else mask
