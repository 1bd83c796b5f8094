"""Direction up, and the height of the floor, from upright people."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from common.calibration.observations import ObservedPerson
from common.calibration.tracklets import Tracklet
from people4d.messages import F64

UPRIGHT_SIGMA_RAD = (
    0.12  # [rad] error of a body's axis in the image: leaning people, one foot in front
)
HEIGHT_SIGMA_M = 0.06  # [m] standard deviation of a torso's height above the floor while walking
SAMPLES_STEP = 5  # grid steps between independent samples of a path
ANKLE_M = 0.12  # [m] mean height of both ankles above the floor while walking
PERSONS_MAX = 4000  # maximum number of used observations of people


@dataclass(frozen=True, slots=True)
class Uprightness:
    """Quadratic form with the direction up as its smallest eigenvector, in one frame."""

    form: F64  # 3x3
    down: F64  # 3, sum of directions from torsos to feet

    def up(self) -> F64:
        """Return the direction up, unit length."""
        _, vectors = np.linalg.eigh(self.form)
        up = vectors[:, 0]
        return np.asarray(-up if up @ self.down > 0 else up)

    def turned(self, rotation: F64) -> "Uprightness":
        """Return the form in another frame: rotation is target_from_source."""
        return Uprightness(rotation @ self.form @ rotation.T, rotation @ self.down)

    @classmethod
    def total(cls, parts: Iterable["Uprightness"]) -> "Uprightness":
        """Return the sum of the forms of all observations."""
        parts = list(parts)
        return cls(sum(p.form for p in parts), sum(p.down for p in parts))  # type: ignore[arg-type]


def uprightness(people: Sequence[ObservedPerson], paths: Sequence[Tracklet]) -> Uprightness:
    """Return the evidence for the direction up from people in one camera.

    The axis of a body lies in the plane of its torso and its feet or shoulders in the image; a
    torso has a constant height while walking.
    """
    form, down = np.zeros((3, 3)), np.zeros(3)
    step = max(len(people) // PERSONS_MAX, 1)
    for person in people[::step]:
        torso = person.position_m / np.linalg.norm(person.position_m)
        low = person.high_ray if person.low_ray is None else person.low_ray
        if low is None:
            continue
        other = low / np.linalg.norm(low)
        down += (other - torso) * (-1 if person.low_ray is None else 1)
        normal = np.cross(torso, other)
        length = float(np.linalg.norm(normal))
        if length > 0.02:
            form += np.outer(normal, normal) / (length * UPRIGHT_SIGMA_RAD) ** 2
    for path in paths:
        apart = path.positions_m - path.positions_m.mean(axis=0)
        form += apart[::SAMPLES_STEP].T @ apart[::SAMPLES_STEP] / HEIGHT_SIGMA_M**2
    return Uprightness(form, down)


def level_from_optical(up: F64) -> F64:
    """Return the rotation (3x3) to axes x forward, y left, z up."""
    forward = np.array([0.0, 0.0, 1.0])
    x = forward - up * (forward @ up)
    if np.linalg.norm(x) < 1e-3:  # straight down: the top of the image is forward
        x = np.array([0.0, -1.0, 0.0]) - up * -up[1]
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(up, x), up])


def torso_heights_m(people: Sequence[ObservedPerson], up: F64) -> F64:
    """Return the heights (N) of torsos above the floor, of people with ankles in view.

    The ankles are at the point of their ray nearest to the vertical through the torso.
    """
    heights = []
    for person in people:
        if person.low_ray is None or not person.is_low_ankle:
            continue
        ray = person.low_ray / np.linalg.norm(person.low_ray)
        # Nearest points of the lines s * ray and torso - h * up.
        along = float(ray @ up)
        matrix = np.array([[1.0, along], [along, 1.0]])
        right = np.array([ray @ person.position_m, up @ person.position_m])
        if 1 - along**2 > 0.02:
            heights.append(float(np.linalg.solve(matrix, right)[1]))
    return np.array(heights) + ANKLE_M
