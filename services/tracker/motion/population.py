"""The people a tracker follows: identities, prediction, correction, birth and death."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from people4d.messages import F64, Track
from services.tracker.interface import Identities, Measurement, Observation
from services.tracker.motion import kalman
from services.tracker.motion.motion import Motion
from services.tracker.motion.standing import Pace, StandOrWalk
from services.tracker.motion.yaw import Yaw, YawState
from services.tracker.strongsort3d.occlusion import Fading


@dataclass(frozen=True, slots=True)
class Look:
    """How a person came by their identity, as `Track` tells it; None where nobody asked."""

    identity: Literal["new", "continued", "reidentified", "refused"] | None = None
    confidence: float | None = None  # 0 to 1
    reason: str = ""


@dataclass(slots=True)
class Target:
    """One person followed."""

    id: int
    x: F64  # state, see the motion model
    P: F64  # its covariance
    score: float  # of the last matched detection
    camera: str  # that saw the person last
    seen_ns: int  # [ns] stamp of the last match
    detection: int | None  # index of the detection matched in this frame
    confirmed: bool
    embedding: F64 | None = None
    look: Look = Look()
    yaw: YawState | None = None
    pace: Pace | None = None  # as two models have them, of which x and P are the mean
    hits: int = 1  # frames matched, the first included
    streak: int = 1  # frames matched since the last miss
    age: int = 1  # frames since the beginning, the first included
    missed: int = 0  # frames since the last match, this one included until it is matched
    hidden: int = 0  # of these, frames in which somebody stood before them
    unwatched: int = 0  # of these, frames in which the camera had turned away from them
    unwatched_ns: int = 0  # [ns] how long it had
    watched_m: F64 | None = None  # [m] 3, where they were when last seen
    shown: float = 1.0  # part of a person's width there that the image had room for, 0 to 1
    at_edge: bool = False  # whether the last picture was cut off at the left or right
    hidden_ns: int = 0  # [ns] stamp of the last of them


State: TypeAlias = tuple[F64, F64, Pace | None]  # x, P and, with two models, what they make


@dataclass(frozen=True, slots=True)
class Survival:
    """When a person is believed, and when given up.

    Args:
        confirm_hits: Matches in a row, the first sight included, that confirm a track.
        tentative_frames: Unmatched frames after which a tentative track is deleted.
        lost_frames: Unmatched frames after which a confirmed track is deleted.
        lost_s: Seconds without a match after which any track is deleted.
    """

    confirm_hits: int
    tentative_frames: int
    lost_frames: int
    lost_s: float

    def ended(self, target: Target) -> bool:
        """Tell whether too many frames have missed the person."""
        limit = self.lost_frames if target.confirmed else self.tentative_frames
        return target.missed - target.hidden - target.unwatched >= limit

    def expired(self, target: Target, stamp_ns: int) -> bool:
        """Tell whether the person was not seen for too long to be predicted."""
        return stamp_ns - target.seen_ns > self.lost_s * 1e9


class Population:
    """All people followed by one tracker.

    A frame counts as missed only for people whom its own camera saw last: another camera may look
    elsewhere. People seen by a camera that fell silent end by time.
    """

    def __init__(
        self,
        motion: Motion,
        survival: Survival,
        yaw: Yaw,
        fading: Fading | None = None,
        paces: StandOrWalk | None = None,
    ) -> None:
        self.targets: list[Target] = []
        self.identities = Identities()
        self._fading = fading
        self._motion = motion
        self._paces = paces
        self._survival = survival
        self._yaw = yaw
        self.stamp_ns: int | None = None

    def clear(self) -> None:
        """Forget everyone and the time; identities go on counting."""
        self.targets, self.stamp_ns = [], None

    def advance(self, observation: Observation) -> None:
        """Give up who was not seen for too long and predict the others to the frame's time."""
        dt_s = self._seconds_to(observation.stamp_ns)
        self.stamp_ns = observation.stamp_ns
        self.targets = [
            t for t in self.targets if not self._survival.expired(t, observation.stamp_ns)
        ]
        if not self.targets:
            return
        states = self._moved(self.targets, dt_s)
        yaws = self._yaw.predict([t.yaw for t in self.targets], dt_s)
        for target, (x, P, pace), yaw in zip(self.targets, states, yaws, strict=True):
            target.x, target.P, target.pace, target.yaw = x, P, pace, yaw
            target.age += 1
            target.detection = None
            target.missed += target.camera == observation.camera

    def doubt(self, covariances_m2: F64, camera: str) -> None:
        """Add covariances (Nx3x3) to the positions of people whom a camera saw last."""
        places = np.ix_(self._motion.position, self._motion.position)
        for target, covariance_m2 in zip(self.targets, covariances_m2, strict=True):
            if target.camera == camera:
                target.P[places] += covariance_m2
                if target.pace:
                    target.pace.P[:, :3, :3] += covariance_m2

    def match(self, pairs: Sequence[tuple[Target, Measurement]], observation: Observation) -> None:
        """Correct people with the measurements matched to them."""
        if not pairs:
            return
        targets, measurements = [t for t, _ in pairs], [m for _, m in pairs]
        z, R = self._motion.measure(measurements), self._motion.noise(measurements)
        states = self._corrected(targets, z, R)
        velocities = np.array([x[self._motion.velocity] for x, _, _ in states])
        yaws = self._yaw.update([t.yaw for t in targets], measurements, velocities)
        for (target, measurement), (x, P, pace), yaw in zip(pairs, states, yaws, strict=True):
            target.x, target.P, target.pace, target.yaw = x, P, pace, yaw
            target.score, target.detection = measurement.score, measurement.index
            target.camera, target.seen_ns = observation.camera, observation.stamp_ns
            target.hits += 1
            target.streak += 1
            target.missed = target.hidden = target.unwatched = target.unwatched_ns = 0
            target.confirmed |= target.streak >= self._survival.confirm_hits

    def finish(self, newcomers: Sequence[Measurement], observation: Observation) -> list[Track]:
        """Delete who is gone, begin a track for each newcomer and return all tracks."""
        self.targets = [t for t in self.targets if not self._survival.ended(t)]
        for target in self.targets:
            if target.missed:
                target.streak = 0
        at_rest = np.zeros((len(newcomers), 3))
        yaws = self._yaw.update([None] * len(newcomers), newcomers, at_rest)
        for measurement, yaw in zip(newcomers, yaws, strict=True):
            x, P = self._motion.start(measurement)
            self.targets.append(
                Target(
                    id=self.identities.new(),
                    x=x,
                    P=P,
                    score=measurement.score,
                    camera=observation.camera,
                    seen_ns=observation.stamp_ns,
                    detection=measurement.index,
                    confirmed=self._survival.confirm_hits <= 1,
                    embedding=measurement.embedding,
                    yaw=yaw,
                    pace=self._paces.start(x, P) if self._paces else None,
                )
            )
        return [self._track(t, observation.stamp_ns) for t in self.targets]

    def predicted(self, stamp_ns: int) -> list[Track]:
        """Return the tracks as they should be at a later time; nothing is remembered of it."""
        present = [t for t in self.targets if not self._survival.expired(t, stamp_ns)]
        if not present:
            return []
        dt_s = self._seconds_to(stamp_ns)
        states = self._moved(present, dt_s)
        yaws = self._yaw.predict([t.yaw for t in present], dt_s)
        return [
            self._track(replace(t, x=x, P=P, yaw=yaw, detection=None), stamp_ns)
            for t, (x, P, _), yaw in zip(present, states, yaws, strict=True)
        ]

    def restore(self, targets: list[Target], stamp_ns: int | None) -> None:
        """Go on with people followed before.

        Raises:
            ValueError: Their states are not of this motion model, or an identity is there twice.
        """
        n = self._motion.H.shape[1]
        if any(t.x.shape != (n,) or t.P.shape != (n, n) for t in targets):
            raise ValueError(f"expected states of {n} numbers, got others")
        if any(t.pace and not t.pace.fits(n) for t in targets):
            raise ValueError(f"expected two states of {n} numbers each, got others")
        if len({t.id for t in targets}) < len(targets) or any(t.id < 1 for t in targets):
            raise ValueError("expected identities >= 1, each once")
        self.targets, self.stamp_ns = targets, stamp_ns
        self.identities.raise_to(max((t.id + 1 for t in targets), default=1))

    def postpone(self, duration_ns: int) -> None:
        """Take a time as not passed: nobody looked, and whoever stands is where they were."""
        if self.stamp_ns is not None:
            self.stamp_ns += duration_ns
        for target in self.targets:
            target.seen_ns += duration_ns

    def _moved(self, targets: Sequence[Target], dt_s: float) -> list[State]:
        """Return predicted states; whoever was not seen slows down, if asked."""
        unseen = np.array([t.missed > 0 for t in targets])
        if self._paces:
            paces = self._paces.predict([_pace(t, self._paces) for t in targets], unseen, dt_s)
            return [(*self._paces.told(pace), pace) for pace in paces]
        x, P = stack(targets)
        if self._fading:
            x, P = self._fading(x, P, unseen, dt_s)
        return [
            (x_k, P_k, None) for x_k, P_k in zip(*self._motion.predict(x, P, dt_s), strict=True)
        ]

    def _corrected(self, targets: Sequence[Target], z: F64, R: F64) -> list[State]:
        if self._paces:
            paces = self._paces.update([_pace(t, self._paces) for t in targets], z, R)
            return [(*self._paces.told(pace), pace) for pace in paces]
        states = kalman.update(*stack(targets), z, self._motion.H, R)
        return [(x, P, None) for x, P in zip(*states, strict=True)]

    def _seconds_to(self, stamp_ns: int) -> float:
        if self.stamp_ns is None:
            return 0.0
        if stamp_ns < self.stamp_ns:
            raise ValueError(f"stamp_ns: expected >= {self.stamp_ns}, got {stamp_ns}")
        return (stamp_ns - self.stamp_ns) / 1e9

    def _track(self, target: Target, stamp_ns: int) -> Track:
        x, motion = target.x, self._motion
        places = motion.position + motion.velocity
        state: Literal["tentative", "confirmed", "lost"] = "tentative"
        if target.confirmed:
            state = "lost" if target.detection is None else "confirmed"
        return Track(
            id=target.id,
            state=state,
            position_m=x[motion.position],
            velocity_mps=x[motion.velocity],
            covariance=target.P[np.ix_(places, places)],
            yaw_rad=self._yaw.read(target.yaw, x[motion.velocity]),
            hits=target.hits,
            age=target.age,
            time_since_update_s=(stamp_ns - target.seen_ns) / 1e9,
            detection=target.detection,
            score=target.score,
            identity=target.look.identity,
            identity_confidence=target.look.confidence,
            identity_reason=target.look.reason,
        )


def _pace(target: Target, paces: StandOrWalk) -> Pace:
    return target.pace or paces.start(target.x, target.P)


def stack(targets: Sequence[Target]) -> tuple[F64, F64]:
    """Return the states (Nxn) and covariances (Nxnxn) of N people."""
    return np.array([t.x for t in targets]), np.array([t.P for t in targets])
