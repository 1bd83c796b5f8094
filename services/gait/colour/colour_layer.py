"""The colour layer: people's boxes followed by their colours (method book section 8.1)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from people4d.messages import F64, U8
from services.gait.colour.config import ColourLayerConfig
from services.gait.colour.histogram import HueSaturation, Part, logs_of, part_of, weights_of
from services.gait.colour.motion_models import STATES, MotionModel
from services.gait.colour.particles import ESTIMATORS, spread_px
from services.gait.colour.pixel_ratios import Colours, PixelRatios
from services.gait.colour.resampling import RESAMPLERS

BOX = [0, 1, 4, 5]  # centre, width and height in a state
SIZE = slice(4, 6)


@dataclass(frozen=True)
class ColourEstimate:
    """One person's box in one frame."""

    box_xyxy_px: F64  # [px] 4: left, top, right, bottom; may reach beyond the image
    velocity_px: F64  # [px a frame] 2: of the centre
    distance: float  # Bhattacharyya distance of the box's colours to the first ones, 0 to 1
    spread_px: float  # [px] standard deviation of the particles' centres


@dataclass
class _Person:
    """What is kept of a person. Colours are learnt only when they are first needed."""

    first: tuple[U8, F64] | None  # the frame and box of the start, until colours are learnt
    states: F64  # Nx8
    before: F64  # Nx8, one frame earlier
    box: F64  # 4: centre x, y, width, height
    aspect: float  # logarithm of the first box's width by its height
    reference: F64  # histogram of the first box
    colours: Colours | None = None  # only with weights by ratio


class ColourLayer:
    """A particle filter for each person, all of them worked out together.

    Args:
        config: Models and constants.
        seed: Of the random numbers; the same seed and calls give the same boxes.

    Source: method book section 8.1.
    """

    def __init__(self, config: ColourLayerConfig, seed: int = 0) -> None:
        self._config = config
        self._generator = np.random.default_rng(seed)
        self._bins = HueSaturation(config.hue_bins, config.saturation_bins, config.points)
        self._ratios = PixelRatios(config, self._bins) if config.weights == "ratio" else None
        self._model = MotionModel(config)
        self._resample = RESAMPLERS[config.resampling]
        self._estimate = ESTIMATORS[config.estimate]
        self._people: dict[int, _Person] = {}

    @property
    def people(self) -> tuple[int, ...]:
        """Who is followed, in the order in which they were started."""
        return tuple(self._people)

    def start(self, person: int, rgb: U8, box_xyxy_px: F64) -> bool:
        """Follow a person from now on, or again from here.

        Args:
            person: Who it is.
            rgb: HxWx3, the frame that the box is of; it is kept until the next update.
            box_xyxy_px: 4: left, top, right, bottom.

        Returns:
            Whether the box shows anything; if not, the person is not followed.
        """
        self.stop(person)
        left, top, right, bottom = np.asarray(box_xyxy_px, np.float64).tolist()
        box = np.array([(left + right) / 2, (top + bottom) / 2, right - left, bottom - top])
        if not np.all(np.isfinite(box)) or box[2:].min() < self._config.box_min_px:
            return False
        height, width = rgb.shape[:2]
        if right < 1 or bottom < 1 or left > width - 1 or top > height - 1:
            return False
        state = np.zeros((self._config.particles, STATES))
        state[:, BOX] = box
        aspect = float(np.log(box[2] / box[3]))
        self._people[person] = _Person((rgb, box), state, state, box, aspect, np.empty(0))
        return True

    def stop(self, person: int) -> None:
        """Follow a person no longer; does nothing if they are not followed."""
        self._people.pop(person, None)

    def update(self, rgb: U8) -> Mapping[int, ColourEstimate]:
        """Return where everyone who is followed is in the next frame.

        Args:
            rgb: HxWx3.
        """
        people = list(self._people.values())
        if not people:
            return {}
        for person in people:
            if person.first is not None:
                self._learn(person, *person.first)
        before = np.stack([person.states for person in people])
        states = self._model(before, np.stack([p.before for p in people]), self._generator)
        boxes = states[..., BOX]
        parts = [self._part(rgb, own) for own in boxes]
        weights = weights_of(np.stack(list(map(self._logs, people, parts, boxes))))
        estimates = self._estimate(states, weights, self._config.robust_window_px)
        chosen = self._resample(weights, self._generator)
        for k, person in enumerate(people):
            person.states, person.before = states[k, chosen[k]], before[k, chosen[k]]
            person.box = estimates[k, BOX]
            if self._ratios is not None and person.colours is not None:
                around = self._ratios.learn(parts[k], person.box).around
                person.colours = Colours(person.colours.person, around)
        return self._told(parts, estimates, spread_px(states, weights))

    def _part(self, rgb: U8, boxes: F64) -> Part:
        """Return what of an image is looked at for boxes."""
        return part_of(rgb, boxes if self._ratios is None else boxes * self._ratios.reach)

    def _learn(self, person: _Person, rgb: U8, box: F64) -> None:
        """Learn a person's colours from the first box."""
        reference = self._bins(rgb, box[None])[0]
        # What of the box lies outside of the image is not of the person.
        person.reference = reference / max(reference.sum(), 1e-9)
        if self._ratios is not None:
            person.colours = self._ratios.learn(self._part(rgb, box[None]), box)
        person.first = None

    def _logs(self, person: _Person, part: Part, boxes: F64) -> F64:
        """Return the logarithms of the weights of boxes, N."""
        config = self._config
        if self._ratios is None or person.colours is None:
            return logs_of(self._bins.distances(part, boxes, person.reference), config.sigma)
        scores = self._ratios.scores(part, boxes, person.colours)
        # By the pixels of a box: neighbouring ones tell the same, however many there are.
        logs = scores / (person.box[2] * person.box[3] * config.ratio_sigma)
        stretch = np.log(boxes[:, 2] / boxes[:, 3]) - person.aspect
        return np.asarray(logs - 0.5 * (stretch / config.aspect_sigma) ** 2)

    def _told(
        self, parts: Sequence[Part], estimates: F64, spreads: F64
    ) -> dict[int, ColourEstimate]:
        told = {}
        for k, (key, person) in enumerate(self._people.items()):
            centre, size = estimates[k, :2], estimates[k, SIZE]
            box = np.concatenate([centre - size / 2, centre + size / 2])
            # The estimate lies among the particles, so the part covers it.
            (distance,) = self._bins.distances(parts[k], person.box[None], person.reference)
            velocity = estimates[k, 2:4]
            told[key] = ColourEstimate(box, velocity, float(distance), float(spreads[k]))
        return told
