"""The colour layer: people's boxes followed by their colours (method book section 8.1)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from common.messages import F64, U8
from services.gait.colour_config import ColourLayerConfig
from services.gait.histogram import HueSaturation, Part, part_of, weights_of
from services.gait.motion_models import STATES, MotionModel
from services.gait.particles import ESTIMATORS, spread_px
from services.gait.resampling import RESAMPLERS

SIZE = slice(4, 6)  # width and height in a state
WIDER = np.array([1.0, 1.0, 2**0.5, 2**0.5])  # of a box of twice the area, which surrounds it


@dataclass(frozen=True)
class ColourEstimate:
    """One person's box in one frame."""

    box_xyxy_px: F64  # [px] 4: left, top, right, bottom; may reach beyond the image
    velocity_px: F64  # [px a frame] 2: of the centre
    distance: float  # Bhattacharyya distance of the box's colours to the first ones, 0 to 1
    spread_px: float  # [px] standard deviation of the particles' centres


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
        self._colours = HueSaturation(config.hue_bins, config.saturation_bins, config.points)
        self._model = MotionModel(config)
        self._surround = config.surround
        self._resample = RESAMPLERS[config.resampling]
        self._estimate = ESTIMATORS[config.estimate]
        self._people: list[int] = []
        self._states = np.empty((0, config.particles, STATES))
        self._before = self._states
        self._references = np.empty((0, self._colours.bins))

    @property
    def people(self) -> tuple[int, ...]:
        """Who is followed, in the order in which they were started."""
        return tuple(self._people)

    def start(self, person: int, rgb: U8, box_xyxy_px: F64) -> bool:
        """Follow a person from now on, or again from here.

        Args:
            person: Who it is.
            rgb: HxWx3, the frame that the box is of.
            box_xyxy_px: 4: left, top, right, bottom.

        Returns:
            Whether the box shows anything; if not, the person is not followed.
        """
        left, top, right, bottom = np.asarray(box_xyxy_px, np.float64).tolist()
        box = np.array([[(left + right) / 2, (top + bottom) / 2, right - left, bottom - top]])
        self.stop(person)
        if not np.all(np.isfinite(box)) or box[0, 2:].min() < self._config.box_min_px:
            return False
        reference = self._colours(rgb, box)
        if not reference.any():
            return False
        state = np.zeros(STATES)
        state[:2], state[SIZE] = box[0, :2], box[0, 2:]
        particles = np.broadcast_to(state, (1, self._config.particles, STATES))
        self._people.append(person)
        self._states = np.concatenate([self._states, particles])
        self._before = np.concatenate([self._before, particles])
        # What of the box lies outside of the image is not of the person.
        self._references = np.concatenate([self._references, reference / reference.sum()])
        return True

    def stop(self, person: int) -> None:
        """Follow a person no longer; does nothing if they are not followed."""
        if person in self._people:
            row = self._people.index(person)
            self._people.pop(row)
            self._states = np.delete(self._states, row, axis=0)
            self._before = np.delete(self._before, row, axis=0)
            self._references = np.delete(self._references, row, axis=0)

    def update(self, rgb: U8) -> Mapping[int, ColourEstimate]:
        """Return where everyone who is followed is in the next frame.

        Args:
            rgb: HxWx3.
        """
        if not self._people:
            return {}
        before = self._states
        states = self._model(before, self._before, self._generator)
        boxes = states[..., [0, 1, 4, 5]]
        covered = boxes * WIDER if self._surround else boxes
        parts = [part_of(rgb, own) for own in covered]
        _, distances = self._distances(parts, boxes)
        weights = weights_of(distances, self._config.sigma)
        estimates = self._estimate(states, weights, self._config.robust_window_px)
        told = self._told(parts, estimates, spread_px(states, weights))
        chosen = self._resample(weights, self._generator)
        self._states = np.take_along_axis(states, chosen[..., None], axis=1)
        self._before = np.take_along_axis(before, chosen[..., None], axis=1)
        return told

    def _distances(self, parts: Sequence[Part], boxes: F64) -> tuple[F64, F64]:
        """Compare the colours of each person's boxes and those around them with the person's.

        Args:
            parts: P, of the image.
            boxes: PxNx4: centre x, y, width, height.

        Returns:
            PxN Bhattacharyya distances, and PxN with what the surroundings add to them.
        """
        found = np.empty((2, *boxes.shape[:2]))
        for row, (part, own) in enumerate(zip(parts, boxes, strict=True)):
            compared = self._colours.compare(part, own, self._references[row], self._surround)
            found[:, row] = compared
        return found[0], found[1]

    def _told(
        self, parts: Sequence[Part], estimates: F64, spreads: F64
    ) -> dict[int, ColourEstimate]:
        centres, sizes = estimates[:, :2], estimates[:, SIZE]
        boxes = np.concatenate([centres - sizes / 2, centres + sizes / 2], axis=1)
        # The estimate lies among the particles, so the parts cover it.
        distances = self._distances(parts, estimates[:, None, [0, 1, 4, 5]])[0][:, 0]
        rows = zip(self._people, boxes, estimates[:, 2:4], distances, spreads, strict=True)
        return {
            person: ColourEstimate(box, velocity, float(distance), float(spread))
            for person, box, velocity, distance, spread in rows
        }
