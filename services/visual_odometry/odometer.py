"""Pose of a base by the frames of the camera on it."""

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
    shift_px,
    small,
    track_points,
)
from services.visual_odometry.fit import MotionPrior, fit_motion
from services.visual_odometry.keyframe import (
    Attempt,
    Comparison,
    Keyframe,
    PoseEstimate,
    detect_landmarks,
    merge,
    on_floor,
    rotated_covariance,
)
from services.visual_odometry.motion_state import (
    MotionState,
    change_keyframe,
    correct,
    initial_state,
    predict,
    prior_of,
)
from services.visual_odometry.reprojection import BaseMount

COUNTERS = (
    *("keyframes", "keyframes_met_again", "no_texture", "no_depth", "not_followed"),
    *("too_few_agree", "uncertain", "implausible", "lost"),
)
OTHERS_MAX = 2  # keyframes that are tried beside the one in use
OTHER_SIGMA_M, OTHER_SIGMA_RAD = 0.05, 0.02  # drift between keyframes
START = PoseEstimate(np.eye(4), np.zeros((3, 3)))


class Odometer:
    """Estimates the pose of the base from frame to frame.

    Each frame is compared with a keyframe: its landmarks are tracked into the frame, and the motion
    is the one that most of them agree on, as far as the base can have moved so since the last
    frame. A keyframe serves as long as enough of its landmarks are found; then an earlier one with
    the same view is used again, or the frame becomes a new one. People do not count as long as they
    are marked, or are fewer landmarks than the room.

    Frames without a pose are counted by cause: `no_texture` and `no_depth` (no keyframe comes of
    it), `not_followed` (another image altogether, blur, darkness), `too_few_agree`, `uncertain`,
    `implausible`. After a long time without a pose (`lost`) the predicted one is taken; its
    covariance has grown accordingly.
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
        self._keyframes: list[Keyframe] = []  # the one in use last
        self._state: MotionState | None = None  # since that one
        self._last: tuple[F32, F32] | None = None  # last pixels of its landmarks, small image
        self.pose = start  # last pose of the base

    def update(self, frame: OdometryFrame) -> PoseEstimate | None:
        """Return the pose of the base in a frame, later than the last; None if unknown.

        In the first frame that is the start.
        """
        grey = self._camera.grey(frame.rgb)
        if self._state is None:
            self._state = initial_state(frame.stamp_ns, self._mount.free, self._config)
            self._add_keyframe(frame, grey, self.pose)
            return self.pose
        comparison = self._track(frame, grey)
        if comparison is None:
            self._recover(frame, grey)
            return None
        if comparison.overlap < self._config.overlap_min:
            comparison = self._earlier_keyframe(frame, grey, comparison)
        self.pose = comparison.pose
        few = comparison.overlap < self._config.overlap_min
        if few and self._add_keyframe(frame, grey, self.pose, comparison):
            zero = np.zeros_like(comparison.fit.covariance)
            self._state = change_keyframe(self._state, np.eye(4), zero)
        return self.pose

    def mark(self, stamp_ns: int, people: PeopleRegions) -> None:
        """Mark landmarks on people who were detected after their frame was used."""
        corners = self._config.corners
        for number, keyframe in enumerate(self._keyframes):
            if keyframe.stamp_ns == stamp_ns:
                self._keyframes[number] = keyframe.with_people(people, self._camera, corners)

    def _track(self, frame: OdometryFrame, grey: U8) -> Comparison | None:
        """Compare a frame with the keyframe in use, then with those of the same view."""
        assert self._state is not None
        if not self._keyframes:
            return None
        free, causes = self._mount.free, Counter[str]()
        state = predict(self._state, frame.stamp_ns, free, self._config)
        for attempt in self._attempts(state, grey):
            comparison = self._compare(frame, grey, attempt, causes)
            if comparison and comparison.keyframe is self._keyframes[-1]:
                self._state = correct(state, comparison.fit, free)
                return self._use(comparison, grey)
            if comparison and comparison.overlap >= self._config.overlap_min:
                predicted, fit = self._predicted(state), comparison.fit
                self._state = change_keyframe(state, fit.before_from_now, fit.covariance)
                return self._use(self._without_jump(comparison, predicted), grey)
        self._counters[next(iter(causes))] += 1  # the cause of the one in use
        return None

    def _attempts(self, state: MotionState, grey: U8) -> Iterator[Attempt]:
        """Yield the keyframe in use, by two predictions of its landmarks, then others."""
        current, prior = self._keyframes[-1], prior_of(state, self._mount.free)
        fixed_from_base = current.pose.matrix @ state.keyframe_from_base
        yield Attempt(current, self._project(current, fixed_from_base), prior)
        if self._last is not None:
            pixels, before = self._last
            yield Attempt(current, pixels + shift_px(before, small(grey)), prior)
        yield from self._others(fixed_from_base, prior)

    def _others(self, fixed_from_base: F64, predicted: MotionPrior) -> Iterator[Attempt]:
        """Yield the keyframes, but for the one in use, with the best view of their landmarks."""
        shares = {
            number: keyframe.project(fixed_from_base, self._mount, self._camera)[1]
            for number, keyframe in enumerate(self._keyframes[:-1])
        }
        sigmas = np.where(self._mount.free < 3, OTHER_SIGMA_M, OTHER_SIGMA_RAD)
        for number in sorted(shares, key=lambda number: -shares[number])[:OTHERS_MAX]:
            if shares[number] < self._config.overlap_min:
                return
            keyframe = self._keyframes[number]
            motion = self._mount.level(invert(keyframe.pose.matrix) @ fixed_from_base)
            prior = MotionPrior(motion, predicted.covariance + np.diag(sigmas**2))
            yield Attempt(keyframe, self._project(keyframe, fixed_from_base), prior)

    def _compare(
        self, frame: OdometryFrame, grey: U8, attempt: Attempt, causes: Counter[str]
    ) -> Comparison | None:
        keyframe, config = attempt.keyframe, self._config.fit
        points, flow = keyframe.points, self._config.flow
        pixels, found = track_points(keyframe.grey, grey, points.pixels, attempt.guess_px, flow)
        room = ~points.people
        if found.sum() < config.points_min or (room & found).sum() < config.room_min:
            causes["not_followed"] += 1
            return None
        focal_px = self._camera.focal_px
        noise = config.sigma_px / focal_px, config.people_sigma_px / focal_px
        matches = points.matches(found, self._camera.rays(pixels[found]), noise)
        fit = fit_motion(matches, self._mount, attempt.prior, config)
        agree = 0 if fit is None else int(fit.inliers[room[found]].sum())
        if fit is None or agree < config.share_min * (room & found).sum():
            causes["too_few_agree"] += 1
            return None
        sigmas, linear = np.sqrt(np.diag(fit.covariance)), self._mount.free < 3
        if max(sigmas[linear]) > config.sigma_max_m or max(sigmas[~linear]) > config.sigma_max_rad:
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
        config = self._config
        far = moved_m > config.speed_max_mps * elapsed_s + 0.1
        return not far and turned_rad <= config.turn_max_radps * elapsed_s + 0.1

    def _earlier_keyframe(self, frame: OdometryFrame, grey: U8, current: Comparison) -> Comparison:
        """Return the frame compared with an earlier keyframe of more overlap, if there is one."""
        assert self._state is not None
        for attempt in self._others(current.pose.matrix, prior_of(self._state, self._mount.free)):
            other = self._compare(frame, grey, attempt, Counter())
            if other and other.overlap >= self._config.overlap_min:
                self._counters["keyframes_met_again"] += 1
                fit = other.fit
                self._state = change_keyframe(self._state, fit.before_from_now, fit.covariance)
                return self._use(self._without_jump(other, current.pose), grey)
        return current

    def _without_jump(self, comparison: Comparison, pose: PoseEstimate) -> Comparison:
        """Return the comparison with the keyframe moved so that it agrees with the pose now.

        Both differ by drift. A little of it is corrected; more would be a jump.
        """
        moved_m, turned_rad = displacement(invert(pose.matrix) @ comparison.pose.matrix)
        if moved_m <= self._config.jump_max_m and turned_rad <= self._config.jump_max_rad:
            return comparison
        then = pose.matrix @ invert(comparison.fit.before_from_now)
        keyframe = replace(comparison.keyframe, pose=PoseEstimate(then, pose.covariance))
        self._keyframes = [keyframe if k is comparison.keyframe else k for k in self._keyframes]
        return replace(comparison, keyframe=keyframe)

    def _add_keyframe(
        self, frame: OdometryFrame, grey: U8, pose: PoseEstimate, before: Comparison | None = None
    ) -> bool:
        """Make a frame a keyframe, if it has enough landmarks."""
        config, corners = self._config, self._config.corners
        points, near, count = detect_landmarks(frame, grey, self._camera, corners)
        if before:
            propagated = before.keyframe.propagate(before, self._mount, self._camera, corners)
            points = merge(propagated, points, corners.cell_px)
        if len(points.pixels) < config.fit.points_min or near < corners.near_min:
            plain = count < config.fit.points_min
            self._counters["no_texture" if plain else "no_depth"] += 1
            return False
        self._counters["keyframes"] += 1
        self._last = points.pixels, small(grey)
        self._keyframes = self._keyframes[-config.keyframes + 1 :] if config.keyframes > 1 else []
        self._keyframes.append(Keyframe(frame.stamp_ns, grey, points, pose))
        return True

    def _recover(self, frame: OdometryFrame, grey: U8) -> None:
        """After some time without a pose, begin anew at the predicted one."""
        assert self._state is not None
        free, config = self._mount.free, self._config
        alone_s = (frame.stamp_ns - self._state.stamp_ns) / 1e9
        if self._keyframes and alone_s < config.lost_s:
            return
        state = predict(self._state, frame.stamp_ns, free, config)
        predicted = self._predicted(state)
        if self._add_keyframe(frame, grey, predicted):
            self._counters["lost"] += 1
            self.pose = predicted
            self._state = change_keyframe(state, np.eye(4), np.zeros((len(free), len(free))))

    def _predicted(self, state: MotionState) -> PoseEstimate:
        """Return the predicted pose of the base, with the covariance of the state."""
        assert self._state is not None
        motion = invert(self._state.keyframe_from_base) @ state.keyframe_from_base
        matrix, count = self.pose.matrix @ motion, len(self._mount.free)
        covariance = on_floor(state.P[:count, :count])
        return PoseEstimate(matrix, self.pose.covariance + rotated_covariance(covariance, matrix))

    def _use(self, comparison: Comparison, grey: U8) -> Comparison:
        others = (k for k in self._keyframes if k is not comparison.keyframe)
        refined = comparison.keyframe.points.refined(comparison.found, comparison.fit)
        self._keyframes = [*others, replace(comparison.keyframe, points=refined)]
        self._last = comparison.pixels, small(grey)
        return replace(comparison, keyframe=self._keyframes[-1])

    def _project(self, keyframe: Keyframe, fixed_from_base: F64) -> F32:
        return keyframe.project(fixed_from_base, self._mount, self._camera)[0]
