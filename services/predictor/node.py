"""Node of the predictor: tracks and odometry in, predictions out."""

from collections import Counter
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from common.geometry.transform_buffer import TransformBuffer
from common.runtime.node import Node, Status
from common.transport.trace import span
from people4d.messages import (
    F64,
    Message,
    MotionProbabilities,
    MovingTransform,
    Odometry,
    PersonPrediction,
    Predictions,
    RobotEncounter,
    StaticTransform,
    Track,
    Tracks,
)
from services.predictor.config import PredictorConfig
from services.predictor.forecast import Forecast, Forecaster, PeopleState
from services.predictor.robot import FINE_S, encounters, path_ahead

SILENT_NS = 3_000_000_000  # maximum silence of the camera whose clock is used [ns]
CLOCK_JUMP_NS = 1_000_000_000  # minimum backward step of the stamps in a clock reset [ns]
ROBOT_AGE_NS = 500_000_000  # maximum age of odometry for the path of the robot [ns]
DISTANCE_MAX_M = 1e5  # maximum distance of a predicted person from the origin [m]
SPEED_MAX_MPS = 12.0  # maximum speed of a predicted person: the fastest sprinters [m/s]
NODE_COUNTERS = (
    "stale",  # messages not newer than the last one
    "other_clock",  # messages of a camera with another clock
    "clock_resets",
    "implausible",  # people too far away, too fast or without a valid covariance
    "too_many",  # people beyond people_max
    "repeated",  # tracks with a duplicate id
)
PLANE = np.ix_((0, 1), (0, 1))  # x and y of a covariance
BASELINE_NS = 300_000_000  # interval over which the robot's motion is measured [ns]
VARIANCE_MIN, VARIANCE_MAX = 1e-6, 1e6


class PredictorNode(Node):
    """Predicts every person of Tracks, at most at `rate_max_hz`.

    Only frames give predictions, since an old prediction would mislead. Extrapolated tracks are
    ignored; without people they give an empty prediction.
    """

    inputs: tuple[type[Message], ...] = (*(Tracks, StaticTransform, MovingTransform, Odometry),)
    required_inputs: ClassVar[tuple[type[Message], ...]] = (Tracks,)

    def __init__(self, config: PredictorConfig) -> None:
        self._config = config
        self._horizons_s = np.round(config.step_s * np.arange(1, config.steps + 1), 9)
        self._published_horizons_s = tuple(self._horizons_s.tolist())
        self._fine_s = np.arange(0, self._horizons_s[-1] + FINE_S / 2, FINE_S)
        self._transforms = TransformBuffer()
        self._frame_id = ""
        self._start_ns = 0
        self._forecaster = Forecaster(self._horizons_s)
        self._camera = ("", 0)  # camera of the clock, and monotonic time of its last tracks
        self._newest_ns: int | None = None
        self._published_ns: int | None = None
        self._sequence = 0
        self._counters = Counter(dict.fromkeys(NODE_COUNTERS, 0))

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Process one message; return the predictions of tracks."""
        if isinstance(message, StaticTransform | MovingTransform | Odometry):
            self._transforms.add_transform(message)
        elif not isinstance(message, Tracks):
            return ()
        elif message.predicted:  # stamps of predictions may be ahead of the next frames
            return () if message.tracks else [self._message(message, (), None)]
        elif (
            self._is_on_our_clock(message, now_ns)
            and self._is_next(message)
            and self._is_due(message)
        ):
            with span("predict"):
                return self._predict(message)
        return ()

    def status(self) -> Status:
        """Return the counters."""
        return Status(counters={**self._counters, **self._transforms.counters})

    def _is_on_our_clock(self, tracks: Tracks, now_ns: int) -> bool:
        """Check that the camera, or its clock, is the one in use."""
        camera, heard_ns = self._camera
        if camera and tracks.camera != camera and now_ns - heard_ns < SILENT_NS:
            newest_ns = self._newest_ns or tracks.stamp_ns
            if abs(tracks.stamp_ns - newest_ns) > CLOCK_JUMP_NS:
                self._counters["other_clock"] += 1
                return False
            return True
        self._camera = tracks.camera, now_ns
        return True

    def _is_next(self, tracks: Tracks) -> bool:
        """Check that tracks are newer than the last; restart after a clock reset."""
        newest_ns = self._newest_ns
        if newest_ns is not None and newest_ns - tracks.stamp_ns > CLOCK_JUMP_NS:
            self._counters["clock_resets"] += 1
            self._restart(tracks)
        elif newest_ns is not None and tracks.stamp_ns <= newest_ns:
            self._counters["stale"] += 1
            return False
        elif newest_ns is None or tracks.frame_id != self._frame_id:
            self._restart(tracks)
        self._newest_ns = tracks.stamp_ns
        return True

    def _restart(self, tracks: Tracks) -> None:
        """Restart with an empty memory, since it is valid for one frame and one clock."""
        self._frame_id, self._start_ns = tracks.frame_id, tracks.stamp_ns
        self._published_ns = None
        self._forecaster = Forecaster(self._horizons_s)

    def _is_due(self, tracks: Tracks) -> bool:
        # Tolerance for irregular stamps
        period_ns = 1e9 / self._config.rate_max_hz
        before_ns = self._published_ns
        return before_ns is None or tracks.stamp_ns - before_ns >= 0.85 * period_ns

    def _predict(self, tracks: Tracks) -> list[Message]:
        people, state = self._plausible(tracks.tracks)
        robot_m = self._robot_path(tracks.frame_id, tracks.stamp_ns)
        now_s = (tracks.stamp_ns - self._start_ns) / 1e9
        forecast = self._forecaster.forecast_people(now_s, state)
        met = self._encounters(state, forecast, robot_m)
        self._published_ns = tracks.stamp_ns
        return [self._message(tracks, _records(people, forecast, met), robot_m)]

    def _message(
        self, tracks: Tracks, people: tuple[PersonPrediction, ...], robot_m: F64 | None
    ) -> Predictions:
        self._sequence += 1
        return Predictions(
            stamp_ns=tracks.stamp_ns,
            sequence=self._sequence - 1,
            trace=tracks.trace,
            frame_id=tracks.frame_id,
            camera=tracks.camera,
            horizons_s=self._published_horizons_s,
            people=people,
            robot_m=None if robot_m is None else _at(self._horizons_s, self._fine_s, robot_m),
        )

    def _plausible(self, tracks: Sequence[Track]) -> tuple[list[Track], PeopleState]:
        """Return the plausible people without duplicates; count the others."""
        config, by_id = self._config, {track.id: track for track in reversed(tracks)}
        people = list(reversed(by_id.values()))
        positions_m = np.array([track.position_m for track in people]).reshape(-1, 3)
        velocities_mps = np.array([track.velocity_mps for track in people]).reshape(-1, 3)
        covariances = np.array([track.covariance for track in people]).reshape(-1, 6, 6)
        plausible = (
            (np.abs(positions_m).max(axis=1) <= DISTANCE_MAX_M)
            & ((velocities_mps**2).sum(axis=1) <= SPEED_MAX_MPS**2)
            & (np.abs(covariances).max(axis=(1, 2)) <= VARIANCE_MAX)
        )
        found = np.flatnonzero(plausible)
        self._counters["repeated"] += len(tracks) - len(people)
        self._counters["implausible"] += len(people) - len(found)
        self._counters["too_many"] += max(len(found) - config.people_max, 0)
        found = found[: config.people_max]
        people = [people[number] for number in found.tolist()]
        variances = covariances[found][:, (3, 4), (3, 4)].mean(axis=1)
        return people, PeopleState(
            ids=np.array([track.id for track in people], np.int64),
            positions_m=np.ascontiguousarray(positions_m[found, :2]),
            velocities_mps=np.ascontiguousarray(velocities_mps[found, :2]),
            covariances_m2=_positive(covariances[found][:, PLANE[0], PLANE[1]]),
            sigma_mps=np.sqrt(variances.clip(VARIANCE_MIN, VARIANCE_MAX)),
            yaws_rad=np.array([np.nan if t.yaw_rad is None else t.yaw_rad for t in people], float),
        )

    def _robot_path(self, frame_id: str, stamp_ns: int) -> F64 | None:
        """Return the future positions of the base at the fine times; None if unknown."""
        base = self._config.base_frame
        if self._transforms.lookup_static(frame_id, base) is not None:
            return None  # no odometry
        if self._transforms.awaits_sample(frame_id, base, stamp_ns - ROBOT_AGE_NS):
            return None
        now = self._transforms.lookup(frame_id, base, stamp_ns)
        before = self._transforms.lookup(frame_id, base, stamp_ns - BASELINE_NS)
        if now is None or before is None:
            return None
        path = path_ahead(now.matrix, before.matrix, BASELINE_NS / 1e9, self._fine_s)
        return path if np.abs(path).max() <= DISTANCE_MAX_M else None

    def _encounters(
        self, state: PeopleState, forecast: Forecast, robot_m: F64 | None
    ) -> F64 | None:
        if robot_m is None:
            return None
        times_s = np.concatenate([[0.0], self._horizons_s])
        paths = np.concatenate([state.positions_m[:, None], forecast.means_m], axis=1)
        return encounters(_at(self._fine_s, times_s, paths), robot_m, FINE_S)


def _at(times_s: F64, known_s: F64, paths: F64) -> F64:
    """Interpolate positions (...xKx2, known at K times) at T times: ...xTx2."""
    after = np.clip(np.searchsorted(known_s, times_s), 1, len(known_s) - 1)
    weight = ((times_s - known_s[after - 1]) / (known_s[after] - known_s[after - 1]))[:, None]
    before_m, after_m = paths[..., after - 1, :], paths[..., after, :]
    found: F64 = before_m + weight * (after_m - before_m)
    return found


def _positive(covariances: F64) -> F64:
    """Return symmetric positive covariances with limited variances."""
    values, vectors = np.linalg.eigh((covariances + np.swapaxes(covariances, 1, 2)) / 2)
    values = np.clip(values, VARIANCE_MIN, VARIANCE_MAX)
    found: F64 = vectors * values[:, None] @ np.swapaxes(vectors, 1, 2)
    return (found + np.swapaxes(found, 1, 2)) / 2


def _records(
    people: Sequence[Track], forecast: Forecast, met: F64 | None
) -> tuple[PersonPrediction, ...]:
    motion = [
        MotionProbabilities(standing=standing, going_on=going_on, turning=turning)
        for standing, going_on, turning in forecast.motion.tolist()
    ]
    groups: list[int] = forecast.groups.tolist()
    return tuple(
        PersonPrediction(
            id=track.id,
            state=track.state,
            position_m=track.position_m,
            velocity_mps=forecast.velocities_mps[number],
            motion=motion[number],
            means_m=forecast.means_m[number],
            covariances_m2=forecast.covariances_m2[number],
            group=groups[number] or None,
            robot=None if met is None else _encounter(met[number]),
        )
        for number, track in enumerate(people)
    )


def _encounter(met: F64) -> RobotEncounter:
    time_s, distance_m, path_m = met.tolist()
    return RobotEncounter(
        closest_approach_s=time_s, closest_distance_m=distance_m, path_distance_m=path_m
    )
