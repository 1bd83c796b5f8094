"""Objects that are detected as people: posters, screens, and figures that never move.

The surface of a person on a poster or a screen is flat. Mannequins, statues and
robots keep their head still; a person who sits or lies may do so for minutes, too (docs/method.md
section 26).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from people4d.messages import F64
from people4d.messages.skeleton import Posture
from services.skeleton.body import INSIDE_M
from services.skeleton.observation import JointObservation
from services.skeleton.posture import CONFIDENCE_MIN
from services.skeleton.skeletons import People

HEAD = 7  # number of joints of face and shoulders, the first ones
WEIGHT_MIN = 1.0  # minimum sum of the confidences of the joints
SMOOTH_S = 1.0  # time constant of the position of the head [s]
# Minimum extent of the positions of a head that moves [m]: smoothed sway of people gives 8 mm
# sideways in 20 s [Winter 1995], a robot seen by the default detector 6 mm at most
MOVED_M = 0.007
STILL_S = 20.0  # mean time until a person moves the head that far [s]
OBJECTS = 0.05  # probability that a figure is an object before any time
MAY_BE_STILL = ("sitting", "lying")  # postures of people who may be motionless for minutes
JOINTS_MIN = 8  # minimum number of readings of a plane
NEAR_M = 0.8  # maximum distance of a reading from the range of the track [m]
SPREAD_M = 0.03  # minimum standard deviation of the readings in two directions [m]
FACING = 0.5  # minimum cosine between the normal of a plane and the line of sight
FLAT_S = 2.0  # time constant of the distance from the plane, and minimum duration of readings [s]
# Distance from the plane that a poster and a person have equally often, and the change that
# changes their odds by e [m]: 1 to 4 mm on posters, at least 24 mm on real people
FLAT_M, FLAT_SCALE_M = 0.015, 0.0025


@dataclass
class _Evidence:
    """Observations of one figure."""

    ray: F64  # smoothed direction of the head from the camera
    low: F64  # least and greatest coordinates of this direction since the head moved
    high: F64
    still_s: float = 0.0  # duration without a displacement
    flat_m2: float = 0.0  # mean squared distance from the plane
    flat_s: float = 0.0  # duration of the readings


class ObjectFilter:
    """Probability of each figure that it is an object."""

    def __init__(self) -> None:
        self._figures: dict[int, _Evidence] = {}

    def restart(self) -> None:
        """Restart all figures."""
        self._figures = {}

    def update(
        self,
        dt_s: float,
        people: People,
        observation: JointObservation,
        postures: Sequence[tuple[Posture, float]],
    ) -> list[float]:
        """Return the probability of each person to be an object.

        Args:
            dt_s: Time since the last frame, at least 0.
            people: Tracks of the frame, N.
            observation: Observed joints of the frame.
            postures: Postures of the frame with their probabilities.
        """
        range_m = np.linalg.norm(people.position_m - observation.origin_m, axis=1)
        heads, has_head = _heads(observation)
        flat_m2, has_plane = _distances_m2(range_m, observation)
        figures = {
            number: self._figures.get(number) or _Evidence(*[heads[row]] * 3)
            for row, number in enumerate(people.ids)
            if number in self._figures or has_head[row]
        }
        self._figures, found = figures, list[float]()
        for row, number in enumerate(people.ids):
            one = figures.get(number)
            if one is not None and has_head[row]:
                counts = postures[row][0] not in MAY_BE_STILL
                _add_head(one, heads[row], float(range_m[row]), dt_s, counts)
            if one is not None and has_plane[row]:
                one.flat_s += dt_s
                share = dt_s / min(max(one.flat_s, dt_s, 1e-3), FLAT_S)
                one.flat_m2 += share * (float(flat_m2[row]) - one.flat_m2)
            found.append(0.0 if one is None else _probability(one))
        return found


def _add_head(one: _Evidence, ray: F64, range_m: float, dt_s: float, counts: bool) -> None:
    """Add the direction of a head at a range; `counts`: its stillness is evidence."""
    one.ray = one.ray + min(dt_s / SMOOTH_S, 1.0) * (ray - one.ray)
    one.low, one.high = np.minimum(one.low, one.ray), np.maximum(one.high, one.ray)
    if not counts or range_m * np.linalg.norm(one.high - one.low) > MOVED_M:
        one.low, one.high, one.still_s = one.ray, one.ray, 0.0
    else:
        one.still_s += dt_s


def _probability(one: _Evidence) -> float:
    """Return the probability that a figure is flat, or still for too long for a person."""
    odds = OBJECTS / (1 - OBJECTS) * (np.exp(min(one.still_s / STILL_S, 50.0)) - 1)
    still, flat = odds / (1 + odds), 0.0
    if one.flat_s >= FLAT_S:
        flat = 1 / (1 + np.exp((np.sqrt(one.flat_m2) - FLAT_M) / FLAT_SCALE_M))
    return float(1 - (1 - still) * (1 - flat))


def _heads(observation: JointObservation) -> tuple[F64, F64]:
    """Return the directions of heads and shoulders, Nx3, and flags of observed ones."""
    weight = observation.confidence[:, :HEAD]
    total = weight.sum(axis=1)
    ray = (weight[..., None] * observation.rays[:, :HEAD]).sum(axis=1)
    return ray / np.maximum(total, 1e-9)[:, None], total >= WEIGHT_MIN


def _distances_m2(range_m: F64, observation: JointObservation) -> tuple[F64, F64]:
    """Return mean squared distances of surfaces from their plane, N, and flags of fitted ones."""
    surface_m = observation.range_m - INSIDE_M
    with np.errstate(invalid="ignore"):
        used = np.abs(surface_m - range_m[:, None]) < NEAR_M
    used &= observation.confidence > CONFIDENCE_MIN
    count = np.maximum(used.sum(axis=1), 1)
    points_m = np.where(used, np.nan_to_num(surface_m), 0.0)[..., None] * observation.rays
    middle_m = points_m.sum(axis=1) / count[:, None]
    away_m = np.where(used[..., None], points_m - middle_m[:, None], 0.0)
    spread_m2, axes = np.linalg.eigh(np.swapaxes(away_m, 1, 2) @ away_m / count[:, None, None])
    ahead = middle_m / np.maximum(np.linalg.norm(middle_m, axis=1), 1e-9)[:, None]
    is_facing = np.abs((axes[..., 0] * ahead).sum(axis=1)) > FACING
    fits = (count >= JOINTS_MIN) & (spread_m2[:, 1] > SPREAD_M**2) & is_facing
    return np.maximum(spread_m2[:, 0], 0.0) * count / np.maximum(count - 3, 1), fits
