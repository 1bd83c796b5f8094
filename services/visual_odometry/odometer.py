"""Pose of a base from the frames of its camera."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from common.geometry.transform_history import displacement
from common.geometry.transforms import invert
from people4d.messages import F32, F64, U8
from services.visual_odometry.config import VisualOdometryConfig
from services.visual_odometry.corners import (
    OdometryFrame,
    PeopleRegions,
    ReducedCamera,
    reduce_for_shift,
    shift_px,
    track_points,
)
from services.visual_odometry.fit import POINTS_MIN, ROOM_MIN, MotionPrior, fit_motion
from services.visual_odometry.keyframe import (
    Attempt,
    Comparison,
    Keyframe,
    PoseEstimate,
    detect_landmarks,
    merge_landmarks,
    on_floor,
    rotated_covariance,
)
from services.visual_odometry.motion_state import (
    MotionState,
    change_keyframe,
    correct_state,
    initial_state,
    predict_state,
    prior_of,
)
from services.visual_odometry.reprojection import BaseMount

COUNTERS = (
    *("keyframes", "keyframes_met_again", "no_texture", "no_depth", "not_followed"),
    *("too_few_agree", "uncertain", "implausible", "lost"),
)
KEYFRAMES = 12  # maximum number of stored keyframes; a base at rest has one and does not drift
OVERLAP_MIN = 0.5  # minimum share of agreeing landmarks of a keyframe
NEAR_MIN = 8  # minimum number of landmarks with depth; fewer give no translation
SIGMA_PX = 0.7  # standard deviation of a tracked point in the room [px]
PEOPLE_SIGMA_PX = 3.0  # standard deviation of a tracked point on a swaying person [px]
SHARE_MIN = 0.4  # minimum share of agreeing points among the tracked points
SIGMA_MAX_M, SIGMA_MAX_RAD = 0.1, 0.03  # maximum standard deviations of an accepted motion
SPEED_MAX_MPS, TURN_MAX_RADPS = 4.0, 6.0  # maximum plausible motion [m/s, rad/s]
OTHERS_MAX = 2  # maximum number of earlier keyframes compared with a frame
OTHER_SIGMA_M, OTHER_SIGMA_RAD = 0.05, 0.02  # standard deviations of drift between keyframes
JUMP_MAX_M, JUMP_MAX_RAD = 0.005, 0.002  # maximum drift corrected at an earlier keyframe
LOST_S = 0.4  # maximum duration without a motion before a new keyframe [s]
START = PoseEstimate(np.eye(4), np.zeros((3, 3)))


class Odometer:
    """Estimates the pose of the base from frame to frame.

    The landmarks of a keyframe are tracked into each frame; the motion is the most likely one for
    most of them. A keyframe is used while enough landmarks agree. Then an earlier keyframe with the
    same view is used again, or the frame becomes a keyframe. Landmarks on people are outliers,
    unless they move like the room.

    Frames without a pose are counted by cause: `no_texture` and `no_depth` (no keyframe possible),
    `not_followed` (another image, blur, darkness), `too_few_agree`, `uncertain`, `implausible`.
    After `LOST_S` without a pose (`lost`) the predicted pose is used, with its covariance.
    """

    def __init__(
        self,
        config: VisualOdometryConfig,
        camera: ReducedCamera,
        mount: BaseMount,
        counters: Counter[str],
        start: PoseEstimate = START,
    ) -> None:
        self._config, self._camera, self._mount = config, camera, mount
        self._counters = counters
        self._keyframes: list[Keyframe] = []  # keyframes, the current one last
        self._state: MotionState | None = None  # motion since the current keyframe
        # Last pixels of the current keyframe's landmarks, and reduced image
        self._last: tuple[F32, F32] | None = None
        self.pose = start  # last pose of the base

    def add_frame(self, frame: OdometryFrame) -> PoseEstimate | None:
        """Return the pose of the base in the next frame, first the start; None if unknown."""
        grey = self._camera.reduce_image(frame.rgb)
        if self._state is None:
            self._state = initial_state(frame.stamp_ns, self._mount.free, self._config)
            self._add_keyframe(frame, grey, self.pose)
            return self.pose
        comparison = self._track(frame, grey)
        if comparison is None:
            self._recover(frame, grey)
            return None
        if comparison.overlap < OVERLAP_MIN:
            comparison = self._earlier_keyframe(frame, grey, comparison)
        self.pose = comparison.pose
        few = comparison.overlap < OVERLAP_MIN
        if few and self._add_keyframe(frame, grey, self.pose, comparison):
            zero = np.zeros_like(comparison.fit.covariance)
            self._state = change_keyframe(self._state, np.eye(4), zero)
        return self.pose

    def mark_people(self, stamp_ns: int, people: PeopleRegions) -> None:
        """Mark landmarks on people in the keyframe of late detections."""
        for number, keyframe in enumerate(self._keyframes):
            if keyframe.stamp_ns == stamp_ns:
                self._keyframes[number] = keyframe.mark_people(people, self._camera)

    def _track(self, frame: OdometryFrame, grey: U8) -> Comparison | None:
        """Compare a frame with the current keyframe, then with earlier ones of the same view."""
        assert self._state is not None
        if not self._keyframes:
            return None
        free, causes = self._mount.free, Counter[str]()
        state = predict_state(self._state, frame.stamp_ns, free, self._config)
        for attempt in self._attempts(state, grey):
            comparison = self._compare(frame, grey, attempt, causes)
            if comparison and comparison.keyframe is self._keyframes[-1]:
                self._state = correct_state(state, comparison.fit, free)
                return self._use(comparison, grey)
            if comparison and comparison.overlap >= OVERLAP_MIN:
                predicted, fit = self._predicted(state), comparison.fit
                self._state = change_keyframe(state, fit.before_from_now, fit.covariance)
                return self._use(self._without_jump(comparison, predicted), grey)
        self._counters[next(iter(causes))] += 1  # cause of the current keyframe
        return None

    def _attempts(self, state: MotionState, grey: U8) -> Iterator[Attempt]:
        """Yield the current keyframe, by two predictions of its landmarks, then earlier ones."""
        current, prior = self._keyframes[-1], prior_of(state, self._mount.free)
        fixed_from_base = current.pose.matrix @ state.keyframe_from_base
        yield Attempt(current, self._project(current, fixed_from_base), prior)
        if self._last is not None:
            pixels, before = self._last
            yield Attempt(current, pixels + shift_px(before, reduce_for_shift(grey)), prior)
        yield from self._others(fixed_from_base, prior)

    def _others(self, fixed_from_base: F64, predicted: MotionPrior) -> Iterator[Attempt]:
        """Yield the earlier keyframes with the largest share of landmarks in view."""
        shares = {
            number: keyframe.project_landmarks(fixed_from_base, self._mount, self._camera)[1]
            for number, keyframe in enumerate(self._keyframes[:-1])
        }
        sigmas = np.where(self._mount.free < 3, OTHER_SIGMA_M, OTHER_SIGMA_RAD)
        for number in sorted(shares, key=lambda number: -shares[number])[:OTHERS_MAX]:
            if shares[number] < OVERLAP_MIN:
                return
            keyframe = self._keyframes[number]
            motion = self._mount.level_motion(invert(keyframe.pose.matrix) @ fixed_from_base)
            prior = MotionPrior(motion, predicted.covariance + np.diag(sigmas**2))
            yield Attempt(keyframe, self._project(keyframe, fixed_from_base), prior)

    def _compare(
        self, frame: OdometryFrame, grey: U8, attempt: Attempt, causes: Counter[str]
    ) -> Comparison | None:
        keyframe, points = attempt.keyframe, attempt.keyframe.points
        pixels, found = track_points(keyframe.grey, grey, points.pixels, attempt.guess_px)
        room = ~points.people
        if found.sum() < POINTS_MIN or (room & found).sum() < ROOM_MIN:
            causes["not_followed"] += 1
            return None
        focal_px = self._camera.focal_px
        noise = SIGMA_PX / focal_px, PEOPLE_SIGMA_PX / focal_px
        matches = points.match_rays(found, self._camera.rays(pixels[found]), noise)
        fit = fit_motion(matches, self._mount, attempt.prior)
        agree = 0 if fit is None else int(fit.inliers[room[found]].sum())
        if fit is None or agree < SHARE_MIN * (room & found).sum():
            causes["too_few_agree"] += 1
            return None
        sigmas, linear = np.sqrt(np.diag(fit.covariance)), self._mount.free < 3
        if max(sigmas[linear]) > SIGMA_MAX_M or max(sigmas[~linear]) > SIGMA_MAX_RAD:
            causes["uncertain"] += 1
            return None
        if not self._plausible(keyframe.pose.matrix @ fit.before_from_now, frame.stamp_ns):
            causes["implausible"] += 1
            return None
        return Comparison(keyframe, pixels, found, fit, agree / max(int(room.sum()), 1))

    def _plausible(self, matrix: F64, stamp_ns: int) -> bool:
        assert self._state is not None
        elapsed_s = (stamp_ns - self._state.stamp_ns) / 1e9
        moved_m, turned_rad = displacement(invert(self.pose.matrix) @ matrix)
        far = moved_m > SPEED_MAX_MPS * elapsed_s + 0.1
        return not far and turned_rad <= TURN_MAX_RADPS * elapsed_s + 0.1

    def _earlier_keyframe(self, frame: OdometryFrame, grey: U8, current: Comparison) -> Comparison:
        """Compare the frame with earlier keyframes; default: the current comparison."""
        assert self._state is not None
        for attempt in self._others(current.pose.matrix, prior_of(self._state, self._mount.free)):
            other = self._compare(frame, grey, attempt, Counter())
            if other and other.overlap >= OVERLAP_MIN:
                self._counters["keyframes_met_again"] += 1
                fit = other.fit
                self._state = change_keyframe(self._state, fit.before_from_now, fit.covariance)
                return self._use(self._without_jump(other, current.pose), grey)
        return current

    def _without_jump(self, comparison: Comparison, pose: PoseEstimate) -> Comparison:
        """Move the keyframe of a comparison so that it agrees with the current pose.

        The difference is drift. A small one is corrected instead; a large correction would be a
        jump.
        """
        moved_m, turned_rad = displacement(invert(pose.matrix) @ comparison.pose.matrix)
        if moved_m <= JUMP_MAX_M and turned_rad <= JUMP_MAX_RAD:
            return comparison
        then = pose.matrix @ invert(comparison.fit.before_from_now)
        keyframe = replace(comparison.keyframe, pose=PoseEstimate(then, pose.covariance))
        self._keyframes = [keyframe if k is comparison.keyframe else k for k in self._keyframes]
        return replace(comparison, keyframe=keyframe)

    def _add_keyframe(
        self, frame: OdometryFrame, grey: U8, pose: PoseEstimate, before: Comparison | None = None
    ) -> bool:
        """Make a frame a keyframe if it has enough landmarks."""
        points, near, count = detect_landmarks(frame, grey, self._camera)
        if before:
            propagated = before.keyframe.propagate_landmarks(before, self._mount, self._camera)
            points = merge_landmarks(propagated, points)
        if len(points.pixels) < POINTS_MIN or near < NEAR_MIN:
            plain = count < POINTS_MIN
            self._counters["no_texture" if plain else "no_depth"] += 1
            return False
        self._counters["keyframes"] += 1
        self._last = points.pixels, reduce_for_shift(grey)
        self._keyframes = self._keyframes[-KEYFRAMES + 1 :]
        self._keyframes.append(Keyframe(frame.stamp_ns, grey, points, pose))
        return True

    def _recover(self, frame: OdometryFrame, grey: U8) -> None:
        """Make a keyframe at the predicted pose after `LOST_S` without a pose."""
        assert self._state is not None
        free = self._mount.free
        alone_s = (frame.stamp_ns - self._state.stamp_ns) / 1e9
        if self._keyframes and alone_s < LOST_S:
            return
        state = predict_state(self._state, frame.stamp_ns, free, self._config)
        predicted = self._predicted(state)
        if self._add_keyframe(frame, grey, predicted):
            self._counters["lost"] += 1
            self.pose = predicted
            self._state = change_keyframe(state, np.eye(4), np.zeros((len(free), len(free))))

    def _predicted(self, state: MotionState) -> PoseEstimate:
        """Return the predicted pose of the base with its covariance."""
        assert self._state is not None
        motion = invert(self._state.keyframe_from_base) @ state.keyframe_from_base
        matrix, count = self.pose.matrix @ motion, len(self._mount.free)
        covariance = on_floor(state.P[:count, :count])
        return PoseEstimate(matrix, self.pose.covariance + rotated_covariance(covariance, matrix))

    def _use(self, comparison: Comparison, grey: U8) -> Comparison:
        others = (k for k in self._keyframes if k is not comparison.keyframe)
        refined = comparison.keyframe.points.refine_depths(comparison.found, comparison.fit)
        self._keyframes = [*others, replace(comparison.keyframe, points=refined)]
        self._last = comparison.pixels, reduce_for_shift(grey)
        return replace(comparison, keyframe=self._keyframes[-1])

    def _project(self, keyframe: Keyframe, fixed_from_base: F64) -> F32:
        return keyframe.project_landmarks(fixed_from_base, self._mount, self._camera)[0]
