"""Detection of a displaced camera by the positions of people in view of two cameras.

Isolated people in view of two cameras give differences of position. A small rotation and shift of
each camera is fitted to the differences; the camera whose fit explains most of them is reported.
Tracks are not changed. Source: docs/method.md, section 28.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from people4d.messages import F64, Track
from services.tracker.cameras.stamp_errors import StampError, Walked, stamp_errors
from services.tracker.interface import Observation

CAMERAS_MAX = 16  # maximum number of cameras that are compared
# maximum number of cameras compared with a frame, the least recently compared first
COMPARED_MAX = 3
SAMPLES_MAX = 300  # maximum number of samples of a pair of cameras
SAMPLES_MIN = 60  # minimum number of samples of a camera for a fit
TOGETHER_NS = 150_000_000  # maximum interval between two compared frames [ns]
WINDOW_NS = 20_000_000_000  # window of the samples [ns]
SAMPLE_NS = 200_000_000  # interval of the samples of a pair [ns]
FRAMES_MAX = 16  # number of stored frames of each camera, for late frames of other cameras
STAMPS_NS = 2_000_000_000  # interval of the fits of errors of stamps [ns]
FIT_NS = 5_000_000_000  # interval of the fits of movements [ns]
# Maximum distance of positions of one person, minimum distance of two people [m]
SAME_M, ALONE_M = 1.0, 1.5
MOVED_M = 0.12  # minimum reported RMS displacement of people [m]
EXPLAINED = 0.3  # share of the cost of all differences that the fit of one camera explains
SCALE_M = 0.2  # scale of differences in the robust cost [m]
ITERATIONS = 6  # iterations of the reweighted fit
PRIOR_RAD, PRIOR_M = 0.2, 0.5  # prior standard deviations of rotation [rad] and shift [m]


@dataclass(frozen=True, slots=True)
class CameraMovement:
    """Movement of a camera since its calibration, by the positions of other cameras."""

    camera: str
    angle_rad: float  # [rad] rotation
    shift_m: float  # [m] shift
    moved_m: float  # [m] RMS displacement of people in its view


@dataclass(slots=True)
class _Frame:
    """People in one frame of a camera."""

    stamp_ns: int
    positions_m: F64  # Nx3
    velocities_mps: F64  # Nx3, velocities of their tracks; NaN if unmatched
    origin_m: F64  # 3, position of the camera


@dataclass(frozen=True, slots=True)
class _Sample:
    """Positions of one person by two cameras."""

    stamp_ns: int
    apart_m: F64  # 3, position by the first camera minus position by the second
    from_first_m: F64  # 3, from the first camera to the person
    from_second_m: F64  # 3, from the second camera to the person
    velocity_mps: F64  # 3, NaN if unknown
    between_s: float  # [s] stamp of the first frame minus the second stamp


class CameraDrift:
    """Compares positions of people between cameras, and finds a displaced camera."""

    def __init__(self) -> None:
        self._frames: dict[str, deque[_Frame]] = {}
        self._samples: dict[tuple[str, str], deque[_Sample]] = {}
        self._compared_ns: dict[tuple[str, str], int] = {}
        self._fit_ns = self._stamps_ns = 0
        self.movement: CameraMovement | None = None  # None: no camera has moved

    def clear(self) -> None:
        """Delete all frames and samples, after transforms changed."""
        self._frames.clear()
        self._samples.clear()
        self._compared_ns.clear()
        self._fit_ns, self.movement = 0, None

    def forget(self, camera: str) -> None:
        """Delete the frames and samples of a camera, after its offset changed."""
        self._frames.pop(camera, None)
        self._samples = {pair: s for pair, s in self._samples.items() if camera not in pair}

    def restamp(self, camera: str, ahead_ns: int) -> None:
        """Correct the stamps of the stored frames of a camera, which were ahead."""
        if frames := self._frames.get(camera):
            for k, frame in enumerate(frames):
                frames[k] = replace(frame, stamp_ns=frame.stamp_ns - ahead_ns)
        for pair, samples in self._samples.items():
            if camera not in pair:
                continue
            later_s = (-1.0 if camera == pair[0] else 1.0) * ahead_ns / 1e9
            for k, sample in enumerate(samples):
                samples[k] = replace(sample, between_s=sample.between_s + later_s)

    def add_frame(self, observation: Observation, tracks: Sequence[Track] = ()) -> None:
        """Compare the people of a frame with people of other cameras at the same time.

        Args:
            observation: Observation of the frame.
            tracks: Tracks after the frame.
        """
        camera, stamp_ns = observation.camera, observation.stamp_ns
        pose = observation.map_from_camera
        if pose is None or (camera not in self._frames and len(self._frames) >= CAMERAS_MAX):
            return
        positions = np.array([m.position_m for m in observation.measurements]).reshape(-1, 3)
        walks = {t.detection: t.velocity_mps for t in tracks if t.detection is not None}
        unknown = np.full(3, np.nan)
        velocities = [walks.get(m.index, unknown) for m in observation.measurements]
        frame = _Frame(stamp_ns, positions, np.array(velocities).reshape(-1, 3), pose[:3, 3])
        self._frames.setdefault(camera, deque(maxlen=FRAMES_MAX)).append(frame)
        if len(self._frames) < 2 or not len(positions):
            return
        others = [
            (self._compared_ns.get(_pair(camera, other), 0), other, at_the_time)
            for other, frames in self._frames.items()
            if other != camera and (at_the_time := _at(frames, stamp_ns)) is not None
        ]
        for _, other, last in sorted(others, key=lambda item: item[:2])[:COMPARED_MAX]:
            self._compared_ns[_pair(camera, other)] = stamp_ns
            self._compare(camera, frame, other, last)
        if stamp_ns - self._fit_ns >= FIT_NS:
            self._fit_ns = stamp_ns
            self.movement = self._find()

    def stamp_errors(self, reference: str, stamp_ns: int) -> dict[str, StampError]:
        """Return errors of stamps against a reference, by camera; empty before the next fit is due.

        Also empty while a camera has moved, since its pose then explains the differences.
        """
        if self.movement or 0 <= stamp_ns - self._stamps_ns < STAMPS_NS:
            return {}
        self._stamps_ns = stamp_ns
        walked = {
            pair: Walked(
                np.array([s.apart_m for s in samples]),
                np.array([s.from_first_m for s in samples]),
                np.array([s.velocity_mps for s in samples]),
                np.array([s.between_s for s in samples]),
            )
            for pair, samples in self._samples.items()
            if samples
        }
        return stamp_errors(walked, reference)

    def reasons(self) -> list[str]:
        """Return a status message that names a displaced camera."""
        found = self.movement
        if found is None:
            return []
        by = f"by about {math.degrees(found.angle_rad):.0f} deg and {100 * found.shift_m:.0f} cm"
        return [f"camera {found.camera} has moved {by}, by the people of others: calibrate again"]

    def _compare(self, camera: str, frame: _Frame, other: str, last: _Frame) -> None:
        if not len(last.positions_m):
            return
        sign = 1.0 if camera < other else -1.0
        samples = self._samples.setdefault(_pair(camera, other), deque(maxlen=SAMPLES_MAX))
        if samples and 0 <= frame.stamp_ns - samples[-1].stamp_ns < SAMPLE_NS:
            return
        between_s = sign * (frame.stamp_ns - last.stamp_ns) / 1e9
        apart = frame.positions_m[:, None] - last.positions_m
        distance = np.linalg.norm(apart, axis=-1)
        for i in range(len(distance)):
            j = int(distance[i].argmin())
            rest = np.concatenate([np.delete(distance[i], j), np.delete(distance[:, j], i)])
            if distance[i, j] > SAME_M or (len(rest) and rest.min() < ALONE_M):
                continue
            rays = frame.positions_m[i] - frame.origin_m, last.positions_m[j] - last.origin_m
            own, its = rays if sign > 0 else rays[::-1]
            # With wrong stamps, velocities are too low after frames of one camera and too high
            # after frames of the other.
            velocity = (frame.velocities_mps[i] + last.velocities_mps[j]) / 2
            samples.append(
                _Sample(frame.stamp_ns, sign * apart[i, j], own, its, velocity, between_s)
            )
        while samples and frame.stamp_ns - samples[0].stamp_ns > WINDOW_NS:
            samples.popleft()

    def _find(self) -> CameraMovement | None:
        cameras = sorted({name for pair, s in self._samples.items() if s for name in pair})
        apart = {
            pair: np.array([s.apart_m for s in samples])
            for pair, samples in self._samples.items()
            if samples
        }
        total = sum(_cost(a) for a in apart.values())
        found = [m for c in cameras if (m := self._fit(c, apart, total)) is not None]
        if not found:
            return None
        explained, best = max(found, key=lambda item: item[0])
        if best.moved_m < MOVED_M or explained < EXPLAINED:
            return None
        if len(cameras) == 2:
            return replace(best, camera=f"{cameras[0]} or {cameras[1]}")  # either may have moved
        return best

    def _fit(
        self, camera: str, apart: dict[tuple[str, str], F64], total: float
    ) -> tuple[float, CameraMovement] | None:
        """Return the explained share of the cost, and the fitted movement of a camera."""
        rays, errors = list[F64](), list[F64]()
        for (a, b), samples in self._samples.items():
            if camera not in (a, b) or not samples:
                continue
            sign = 1.0 if camera == a else -1.0
            errors.append(sign * apart[a, b])
            rays.append(
                np.array([s.from_first_m if sign > 0 else s.from_second_m for s in samples])
            )
        if not rays or sum(map(len, rays)) < SAMPLES_MIN:
            return None
        ray, error = np.concatenate(rays), np.concatenate(errors)
        # A rotation w and a shift t displace a person at p by w x p + t.
        jacobian = np.zeros((len(ray), 3, 6))
        x, y, z = ray.T
        jacobian[:, 0, 1], jacobian[:, 0, 2] = z, -y
        jacobian[:, 1, 0], jacobian[:, 1, 2] = -z, x
        jacobian[:, 2, 0], jacobian[:, 2, 1] = y, -x
        jacobian[:, [0, 1, 2], [3, 4, 5]] = 1.0
        prior = np.diag([1 / PRIOR_RAD] * 3 + [1 / PRIOR_M] * 3)
        remaining = error
        for _ in range(ITERATIONS):
            weights = 1 / (1 + (remaining**2).sum(axis=1) / SCALE_M**2)
            left = (weights[:, None, None] * jacobian).reshape(-1, 6)
            right = (weights[:, None] * error).ravel()
            solution, *_ = np.linalg.lstsq(
                np.vstack([left, prior]), np.append(right, np.zeros(6)), rcond=None
            )
            explained = jacobian @ solution
            remaining = error - explained
        gained = _cost(error) - _cost(remaining)
        return gained / max(total, 1e-12), CameraMovement(
            camera=camera,
            angle_rad=float(np.linalg.norm(solution[:3])),
            shift_m=float(np.linalg.norm(solution[3:])),
            moved_m=float(np.sqrt((explained**2).sum(axis=1).mean())),
        )


def _at(frames: Sequence[_Frame], stamp_ns: int) -> _Frame | None:
    """Return the frame nearest to a time; None if it is too far."""
    nearest = min(reversed(frames), key=lambda frame: abs(frame.stamp_ns - stamp_ns))
    return nearest if abs(nearest.stamp_ns - stamp_ns) <= TOGETHER_NS else None


def _pair(camera: str, other: str) -> tuple[str, str]:
    return (camera, other) if camera < other else (other, camera)


def _cost(differences_m: F64) -> float:
    """Return the Geman-McClure cost of differences (Nx3), at most 1 each."""
    squares_m2 = (differences_m**2).sum(axis=1)
    return float((squares_m2 / (squares_m2 + SCALE_M**2)).sum())
