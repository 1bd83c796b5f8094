"""Where a base is, by what the camera on it sees."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from common.geometry.transform_history import displacement
from common.geometry.transforms import invert
from people4d.messages import F32, F64, U8
from services.visual_odometry.config import VisualOdometryConfig
from services.visual_odometry.course import Course, begin, correct, predict, prior_of, since
from services.visual_odometry.fit import BOOL, Fit, Mount, Prior, fit_motion
from services.visual_odometry.flow import follow, shift_px, small
from services.visual_odometry.keyframe import (
    Again,
    Keyframe,
    Place,
    Points,
    look_for_corners,
    together,
)
from services.visual_odometry.points import Lens, People, View

COUNTERS = (
    *("keyframes", "keyframes_met_again", "no_texture", "no_depth", "not_followed"),
    *("too_few_agree", "unsure", "implausible", "lost"),
)
OTHERS_MAX = 2  # keyframes that are tried beside the one in use
# What keyframes may be off one another, by drift between them
OTHER_SIGMA_M, OTHER_SIGMA_RAD = 0.05, 0.02
# On the standard deviation of a motion as it adds up: one keyframe errs as the one before
DRIFT_FACTOR = 2.5
FLOOR = np.array([0, 1, 5])  # of a twist: along x and y, and about the vertical
START = Place(np.eye(4), np.zeros((3, 3)))


@dataclass(frozen=True)
class _Try:
    """A keyframe to compare a frame with."""

    keyframe: Keyframe
    guess_px: F32  # Nx2, where its points may be seen
    prior: Prior  # the motion since


@dataclass(frozen=True)
class _Found:
    """A keyframe that a frame was compared with, and what came out."""

    keyframe: Keyframe
    pixels: F32  # Nx2, where its points are seen
    there: BOOL  # N, which of them were found again
    fit: Fit
    share: float  # of its points that were found again and agree

    @property
    def place(self) -> Place:
        """Where the base is: at the keyframe's place, moved by what was found since."""
        then = self.keyframe.place
        matrix = then.matrix @ self.fit.before_from_now
        lever = np.eye(3)
        away_m = matrix[:2, 3] - then.matrix[:2, 3]
        lever[:2, 2] = -away_m[1], away_m[0]  # what an error of the keyframe's heading does here
        rows = FLOOR if len(self.fit.covariance) > len(FLOOR) else np.arange(len(FLOOR))
        own = self.fit.covariance + self.fit.common
        own = DRIFT_FACTOR**2 * _turned(own[np.ix_(rows, rows)], matrix)
        return Place(matrix, lever @ then.covariance @ lever.T + own)


class Odometer:
    """Follows the base from frame to frame.

    Each frame is compared with a keyframe: its points are followed to where they are seen now, and
    the motion is what most of them agree on, as far as the base can have moved so since the last
    frame. A keyframe serves as long as enough of its points are found; then one that was left
    before and looks the same way is taken again, or the frame becomes a new one. People do not
    count as long as they are left out, or are fewer points than the room.

    What cannot be told is counted, by its cause: `no_texture` and `no_depth` (no keyframe comes of
    it), `not_followed` (another picture altogether, blur, darkness), `too_few_agree`, `unsure`,
    `implausible`. Of a base that was not known for long (`lost`) only a guess is left of where it
    is; its covariance says so.

    Args:
        config: The configuration.
        lens: Of the camera.
        mount: Of the camera.
        counters: Counts `COUNTERS`.
        start: Where the base is in the first frame.
    """

    def __init__(
        self,
        config: VisualOdometryConfig,
        lens: Lens,
        mount: Mount,
        counters: Counter[str],
        start: Place = START,
    ) -> None:
        self._config, self._lens, self._mount = config, lens, mount
        self._counters = counters
        self._keyframes: list[Keyframe] = []  # the one in use last
        self._course: Course | None = None  # since that one
        self._last: tuple[F32, F32] | None = None  # where its points were seen last, small picture
        self.place = start  # where the base was last

    def update(self, view: View) -> Place | None:
        """Return where the base is in a frame, later than the last; None if that is not known.

        The first frame is where it starts.

        Args:
            view: The frame.
        """
        grey = self._lens.grey(view.rgb)
        if self._course is None:
            self._course = begin(view.stamp_ns, self._mount.free, self._config)
            self._begin(view, grey, self.place)
            return self.place
        found = self._locate(view, grey)
        if found is None:
            self._lose(view, grey)
            return None
        if found.share < self._config.overlap_min:
            found = self._again(view, grey, found)
        self.place = found.place
        if found.share < self._config.overlap_min and self._begin(view, grey, self.place, found):
            self._course = since(self._course, np.eye(4), np.zeros_like(found.fit.covariance))
        return self.place

    def mark(self, stamp_ns: int, people: People) -> None:
        """Take people who were found in a frame after it was seen."""
        corners = self._config.corners
        for number, keyframe in enumerate(self._keyframes):
            if keyframe.stamp_ns == stamp_ns:
                self._keyframes[number] = keyframe.with_people(people, self._lens, corners)

    def _locate(self, view: View, grey: U8) -> _Found | None:
        """Compare a frame with the keyframe in use, then with those that look the same way."""
        assert self._course is not None
        if not self._keyframes:
            return None
        free, causes = self._mount.free, Counter[str]()
        course = predict(self._course, view.stamp_ns, free, self._config)
        for attempt in self._tries(course, grey):
            found = self._compare(view, grey, attempt, causes)
            if found and found.keyframe is self._keyframes[-1]:
                self._course = correct(course, found.fit, free)
                return self._use(found, grey)
            if found and found.share >= self._config.overlap_min:
                guess = self._guessed(course)
                self._course = since(course, found.fit.before_from_now, found.fit.covariance)
                return self._use(self._without_jump(found, guess), grey)
        self._counters[next(iter(causes))] += 1  # what was wrong with the one in use
        return None

    def _tries(self, course: Course, grey: U8) -> Iterator[_Try]:
        """Yield the keyframe in use, with what its points may have done, then others."""
        current, prior = self._keyframes[-1], prior_of(course, self._mount.free)
        fixed_from_base = current.place.matrix @ course.keyframe_from_base
        yield _Try(current, self._seen_from(current, fixed_from_base), prior)
        if self._last is not None:
            pixels, before = self._last
            yield _Try(current, pixels + shift_px(before, small(grey)), prior)
        yield from self._others(fixed_from_base, prior)

    def _others(self, fixed_from_base: F64, known: Prior) -> Iterator[_Try]:
        """Yield the keyframes, but for the one in use, whose points should be seen best."""
        shares = {
            number: keyframe.seen_from(fixed_from_base, self._mount, self._lens)[1]
            for number, keyframe in enumerate(self._keyframes[:-1])
        }
        sigmas = np.where(self._mount.free < 3, OTHER_SIGMA_M, OTHER_SIGMA_RAD)
        for number in sorted(shares, key=lambda number: -shares[number])[:OTHERS_MAX]:
            if shares[number] < self._config.overlap_min:
                return
            keyframe = self._keyframes[number]
            way = self._mount.level(invert(keyframe.place.matrix) @ fixed_from_base)
            prior = Prior(way, known.covariance + np.diag(sigmas**2))
            yield _Try(keyframe, self._seen_from(keyframe, fixed_from_base), prior)

    def _compare(self, view: View, grey: U8, attempt: _Try, causes: Counter[str]) -> _Found | None:
        keyframe, config = attempt.keyframe, self._config.fit
        points = keyframe.points
        flow = self._config.flow
        pixels, there = follow(keyframe.grey, grey, points.pixels, attempt.guess_px, flow)
        room = ~points.people
        if there.sum() < config.points_min or (room & there).sum() < config.room_min:
            causes["not_followed"] += 1
            return None
        focal_px = self._lens.focal_px
        noise = config.sigma_px / focal_px, config.people_sigma_px / focal_px
        sights = points.sights(there, self._lens.rays(pixels[there]), noise)
        fit = fit_motion(sights, self._mount, attempt.prior, config)
        agree = 0 if fit is None else int(fit.inliers[room[there]].sum())
        if fit is None or agree < config.share_min * (room & there).sum():
            causes["too_few_agree"] += 1
            return None
        sigmas, way = np.sqrt(np.diag(fit.covariance)), self._mount.free < 3
        if max(sigmas[way]) > config.sigma_max_m or max(sigmas[~way]) > config.sigma_max_rad:
            causes["unsure"] += 1
            return None
        if not self._plausible(keyframe.place.matrix @ fit.before_from_now, view.stamp_ns):
            causes["implausible"] += 1
            return None
        return _Found(keyframe, pixels, there, fit, agree / max(int(room.sum()), 1))

    def _plausible(self, matrix: F64, stamp_ns: int) -> bool:
        assert self._course is not None
        elapsed_s = (stamp_ns - self._course.stamp_ns) / 1e9
        moved_m, turned_rad = displacement(invert(self.place.matrix) @ matrix)
        config = self._config
        far = moved_m > config.speed_max_mps * elapsed_s + 0.1
        return not far and turned_rad <= config.turn_max_radps * elapsed_s + 0.1

    def _again(self, view: View, grey: U8, found: _Found) -> _Found:
        """Return the frame compared with an earlier keyframe that serves better, if any does."""
        assert self._course is not None
        for attempt in self._others(found.place.matrix, prior_of(self._course, self._mount.free)):
            other = self._compare(view, grey, attempt, Counter())
            if other and other.share >= self._config.overlap_min:
                self._counters["keyframes_met_again"] += 1
                fit = other.fit
                self._course = since(self._course, fit.before_from_now, fit.covariance)
                return self._use(self._without_jump(other, found.place), grey)
        return found

    def _without_jump(self, found: _Found, place: Place) -> _Found:
        """Return what was found, with the keyframe where it lies as seen from the base now.

        What was known of both differs by drift. A little of it is made good; more would be a jump.
        """
        moved_m, turned_rad = displacement(invert(place.matrix) @ found.place.matrix)
        if moved_m <= self._config.jump_max_m and turned_rad <= self._config.jump_max_rad:
            return found
        moved = Place(place.matrix @ invert(found.fit.before_from_now), place.covariance)
        keyframe = replace(found.keyframe, place=moved)
        self._keyframes = [keyframe if k is found.keyframe else k for k in self._keyframes]
        return replace(found, keyframe=keyframe)

    def _begin(self, view: View, grey: U8, place: Place, before: _Found | None = None) -> bool:
        """Make a frame a keyframe, if there is enough to see in it."""
        config = self._config
        corners = look_for_corners(view, grey, self._lens, config.corners)
        points = corners.points
        if before:
            points = together(self._handed_on(place, before), points, config.corners.cell_px)
        if len(points.pixels) < config.fit.points_min or corners.near < config.corners.near_min:
            plain = corners.count < config.fit.points_min
            self._counters["no_texture" if plain else "no_depth"] += 1
            return False
        self._counters["keyframes"] += 1
        self._last = points.pixels, small(grey)
        self._keyframes = self._keyframes[-config.keyframes + 1 :] if config.keyframes > 1 else []
        self._keyframes.append(Keyframe(view.stamp_ns, grey, points, place))
        return True

    def _handed_on(self, place: Place, before: _Found) -> Points:
        rows = np.flatnonzero(before.there)[before.fit.inliers]
        seen = Again(rows, before.pixels[rows], self._lens.rays(before.pixels[rows]))
        keyframe = before.keyframe
        return keyframe.handed_on(place.matrix, seen, self._mount, self._config.corners)

    def _lose(self, view: View, grey: U8) -> None:
        """After some time begin anew where the base is thought to be."""
        assert self._course is not None
        free, config = self._mount.free, self._config
        alone_s = (view.stamp_ns - self._course.stamp_ns) / 1e9
        if self._keyframes and alone_s < config.lost_s:
            return
        course = predict(self._course, view.stamp_ns, free, config)
        guess = self._guessed(course)
        if self._begin(view, grey, guess):
            self._counters["lost"] += 1
            self.place = guess
            self._course = since(course, np.eye(4), np.zeros((len(free), len(free))))

    def _guessed(self, course: Course) -> Place:
        """Return where the base is thought to be, as doubtful as the course is."""
        assert self._course is not None
        way = invert(self._course.keyframe_from_base) @ course.keyframe_from_base
        matrix, count = self.place.matrix @ way, len(self._mount.free)
        known = course.P[:count, :count]
        doubt = known if self._mount.planar else known[np.ix_(FLOOR, FLOOR)]
        return Place(matrix, self.place.covariance + _turned(doubt, matrix))

    def _use(self, found: _Found, grey: U8) -> _Found:
        kept = (k for k in self._keyframes if k is not found.keyframe)
        refined = found.keyframe.points.refined(found.there, found.fit)
        self._keyframes = [*kept, replace(found.keyframe, points=refined)]
        self._last = found.pixels, small(grey)
        return replace(found, keyframe=self._keyframes[-1])

    def _seen_from(self, keyframe: Keyframe, fixed_from_base: F64) -> F32:
        return keyframe.seen_from(fixed_from_base, self._mount, self._lens)[0]


def _turned(covariance: F64, fixed_from_base: F64) -> F64:
    """Return the covariance (3x3) of x, y and heading in the fixed frame, from that in the base."""
    turn = np.eye(3)
    turn[:2, :2] = fixed_from_base[:2, :2]
    return np.asarray(turn @ covariance @ turn.T)
