"""The set of tracks: identities, prediction, update, and the life cycle of each."""

from collections.abc import Container, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from people4d.messages import F64, Track
from services.tracker.interface import IdCounter, Measurement, Observation
from services.tracker.motion.lifecycle import Lifecycle
from services.tracker.motion.motion import Motion
from services.tracker.motion.past_frames import PastFrames, PastMatch
from services.tracker.motion.state_filter import KalmanFilter, StateFilter
from services.tracker.motion.track_filter import TrackFilter
from services.tracker.motion.track_record import TrackRecord
from services.tracker.motion.yaw import VelocityYaw

SENDS_NS = 1_000_000_000  # maximum time since the last frame of an active camera [ns]
INTERVAL_MAX_NS = 200_000_000  # maximum counted interval between two frames [ns]
MOVED_S = 1.0  # duration of the prediction over a long outage of frames [s]


class TrackSet:
    """All tracks of one tracker.

    A frame counts as missed only for tracks last matched by its camera, since another camera may
    have another view. Tracks of a silent camera end by time.
    """

    def __init__(
        self,
        motion: Motion,
        lifecycle: Lifecycle,
        yaw: VelocityYaw,
        state_filter: StateFilter | None = None,
    ) -> None:
        self.records: list[TrackRecord] = []
        self.ids = IdCounter()
        self.stamp_ns: int | None = None
        self._frame_ns: dict[str, int] = {}  # stamp of the last frame, by active camera
        self.elapsed_ns = 0  # [ns] time between the last two frames
        self._motion = motion
        self._state_filter = state_filter or KalmanFilter(motion)
        self._lifecycle = lifecycle
        self._yaw = yaw
        self._position, self._velocity = motion.position, motion.velocity
        self._filter = TrackFilter(self._state_filter, yaw)
        self._past = PastFrames(self._filter)
        self._now_ns: int | None = None  # time of the newest frame, during a late one

    @property
    def confirmed(self) -> list[TrackRecord]:
        """The confirmed tracks."""
        return [t for t in self.records if t.confirmed]

    @property
    def _of_several(self) -> bool:
        """True if several cameras send."""
        return len(self._frame_ns) > 1

    def positions_m(self, records: Sequence[TrackRecord]) -> F64:
        """Return the positions (Nx3) of tracks."""
        return np.array([t.x for t in records])[:, self._position] if records else np.empty((0, 3))

    def end(self, ended: Container[int]) -> None:
        """Delete tracks by id."""
        self.records = [t for t in self.records if t.id not in ended]

    def clear(self) -> None:
        """Delete all tracks and the time; identities are not reused."""
        self.records, self.stamp_ns, self._frame_ns = [], None, {}
        self._now_ns = None
        self._past.clear()

    def bridge_absence(self, stamp_ns: int) -> int:
        """Shorten a long outage of frames before a frame; return the skipped time [ns].

        After a long outage people are expected near their last positions; velocities are outdated.
        """
        absent_s = self._seconds_to(stamp_ns)
        if self.stamp_ns is None or not self._lifecycle.bridges(absent_s):
            return 0
        skipped_ns = int((absent_s - MOVED_S) * 1e9)
        self.stamp_ns += skipped_ns
        for record in self.records:
            record.matched_ns += skipped_ns
            record.begun_ns += skipped_ns
        return skipped_ns

    def predict(self, observation: Observation) -> None:
        """Delete expired tracks and predict the others to the frame's time.

        For a late frame all tracks go back to its time until `manage`.
        """
        if self.stamp_ns is not None and observation.stamp_ns < self.stamp_ns:
            self._now_ns = self.stamp_ns
            self.stamp_ns = self._past.go_back(self.records, observation.stamp_ns)
        self.bridge_absence(observation.stamp_ns)
        dt_s = self._seconds_to(observation.stamp_ns)
        before_ns = self.stamp_ns
        self.elapsed_ns = 0 if before_ns is None else observation.stamp_ns - before_ns
        self.stamp_ns = observation.stamp_ns
        self._frame_ns[observation.camera] = observation.stamp_ns
        oldest_ns = observation.stamp_ns - SENDS_NS
        self._frame_ns = {c: ns for c, ns in self._frame_ns.items() if ns > oldest_ns}
        self.records = self._alive(observation.stamp_ns)
        if not self.records:
            return
        self._filter.predict(self.records, dt_s, self._past.noise_factor(observation, dt_s))
        for record in self.records:
            record.age += 1
            record.detection = None
            record.missed += record.camera == observation.camera
            if record.matched_ns == before_ns:
                begin_ns = observation.stamp_ns - INTERVAL_MAX_NS
                record.missed_since_ns = max(record.matched_ns, begin_ns)

    def add_covariance(self, covariances_m2: F64, camera: str) -> None:
        """Add covariances (Nx3x3) to the positions of tracks last matched by a camera."""
        position = self._position, self._position
        for record, covariance_m2 in zip(self.records, covariances_m2, strict=True):
            if record.camera == camera:
                record.P[position] += covariance_m2
                if record.imm:
                    record.imm.P[:, :3, :3] += covariance_m2

    def update(
        self, matches: Sequence[tuple[TrackRecord, Measurement]], observation: Observation
    ) -> None:
        """Update tracks with the measurements matched to them."""
        if not matches:
            return
        records, measurements = [t for t, _ in matches], [m for _, m in matches]
        z, R = self._motion.measure(measurements), self._motion.noise(measurements)
        self._filter.update(records, measurements, z, R)
        for k, (record, measurement) in enumerate(matches):
            self._past.add_match(record, PastMatch(measurement, z[k], R[k]))
            record.score, record.detection = measurement.score, measurement.index
            record.camera, record.matched_ns = observation.camera, observation.stamp_ns
            record.hits += 1
            change = measurement.person_log_odds - record.person_log_odds
            record.person_log_odds += change / record.hits
            record.streak += 1
            record.missed = record.hidden = 0
            record.confirmed |= self._lifecycle.confirms(record, self._of_several)

    def manage(self, unmatched: Sequence[Measurement], observation: Observation) -> list[Track]:
        """Delete ended tracks, begin one for each unmatched measurement and return all tracks.

        After a late frame the tracks return to the present, with all later matches.
        """
        self.records = [t for t in self.records if not self._lifecycle.ended(t)]
        for record in self.records:
            if record.missed:
                record.streak = 0
        for measurement in unmatched:
            self.begin(measurement, observation, self.ids.new())
        self._past.add_frame(self.records, observation)
        tracks = self.tracks(observation.stamp_ns)
        if self._now_ns is not None:
            self._past.go_forward(self.records, observation.stamp_ns)
            self.stamp_ns, self._now_ns = self._now_ns, None
        return tracks

    def begin(self, measurement: Measurement, observation: Observation, identity: int) -> None:
        """Begin a track."""
        x, P = self._motion.start(measurement)
        (yaw,) = self._yaw.update([None], [measurement])
        record = TrackRecord(
            id=identity,
            x=x,
            P=P,
            score=measurement.score,
            camera=observation.camera,
            matched_ns=observation.stamp_ns,
            begun_ns=observation.stamp_ns,
            detection=measurement.index,
            confirmed=self._lifecycle.confirm_hits <= 1,
            embedding=measurement.embedding,
            yaw=yaw,
            person_log_odds=measurement.person_log_odds,
            imm=self._state_filter.start(x, P),
        )
        self.records.append(record)

    def tracks(self, stamp_ns: int) -> list[Track]:
        """Return all tracks."""
        return [self._track(t, stamp_ns) for t in self.records]

    def predicted(self, stamp_ns: int) -> list[Track]:
        """Return the tracks predicted to a later time; the state does not change."""
        records, dt_s = self._alive(stamp_ns), self._seconds_to(stamp_ns)
        if not records:
            return []
        return [
            self._track(replace(t, x=x, P=P, yaw=yaw, detection=None), stamp_ns)
            for t, ((x, P, _), yaw) in zip(
                records, self._filter.predicted(records, dt_s), strict=True
            )
        ]

    def restore(self, records: list[TrackRecord], stamp_ns: int | None) -> None:
        """Continue with tracks of a checkpoint."""
        self.records, self.stamp_ns = records, stamp_ns

    def _alive(self, stamp_ns: int) -> list[TrackRecord]:
        expired = self._lifecycle.expired
        return [t for t in self.records if not expired(t, stamp_ns, self._of_several)]

    def _seconds_to(self, stamp_ns: int) -> float:
        return 0.0 if self.stamp_ns is None else (stamp_ns - self.stamp_ns) / 1e9

    def _track(self, record: TrackRecord, stamp_ns: int) -> Track:
        x = record.x
        velocity_mps = x[self._velocity]
        state: Literal["tentative", "confirmed", "lost"] = "tentative"
        if record.confirmed:
            state = "lost" if record.detection is None else "confirmed"
        return Track(
            id=record.id,
            state=state,
            position_m=x[self._position],
            velocity_mps=velocity_mps,
            covariance=self._motion.position_and_velocity(record.P),
            yaw_rad=self._yaw.read(record.yaw, velocity_mps),
            hits=record.hits,
            age=record.age,
            time_since_update_s=max(stamp_ns - record.matched_ns, 0) / 1e9,
            detection=record.detection,
            score=record.score,
            identity=record.identity.identity,
            identity_confidence=record.identity.confidence,
            identity_reason=record.identity.reason,
        )
