"""The colour layer: boxes of people tracked by their colours (docs/method.md, section 8.1)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from people4d.messages import F64, U8
from services.gait.colour.colour_ratio import ColourModel, ColourRatio
from services.gait.colour.histogram import (
    HsvPatch,
    HueSaturationHistogram,
    hsv_patch,
    log_likelihoods,
    normalised_weights,
)
from services.gait.config import ColourLayerConfig
from services.gait.particles import BOX_MIN_PX, STATES, BoxMotionModel, resample_systematic

BOX = [0, 1, 4, 5]  # centre, width and height in a state
SIZE = slice(4, 6)
RATIO_SIGMA = 0.05  # Standard deviation of the mean log-likelihood ratio over a box
# Standard deviation of the logarithm of the aspect ratio, relative to the first box
ASPECT_SIGMA = 0.15


@dataclass(frozen=True)
class ColourEstimate:
    """One person's box in one frame."""

    box_xyxy_px: F64  # [px] 4: left, top, right, bottom; may reach beyond the image
    distance: float  # Bhattacharyya distance of the box's colours to the first ones, 0 to 1


@dataclass
class _BoxFilter:
    """State of one person's filter. Colours are learnt on first use."""

    initial: tuple[U8, F64] | None  # first frame and box, until colours are learnt
    states: F64  # Nx8
    previous: F64  # Nx8, one frame earlier
    box: F64  # 4: centre x, y, width, height
    log_aspect: float  # logarithm of width by height of the first box
    reference: F64  # histogram of the first box
    model: ColourModel | None = None  # colour model; None unless weights are ratios


class ColourLayer:
    """A particle filter for each person, all computed together.

    Source: docs/method.md, section 8.1.
    """

    def __init__(self, config: ColourLayerConfig, seed: int = 0) -> None:
        self._config = config
        self._generator = np.random.default_rng(seed)
        self._histogram = HueSaturationHistogram()
        by_ratio = config.weights == "ratio"
        self._ratio = ColourRatio(self._histogram) if by_ratio else None
        self._motion = BoxMotionModel(config)
        self._filters: dict[int, _BoxFilter] = {}

    @property
    def people(self) -> tuple[int, ...]:
        """Ids of the tracked people, in the order of their start."""
        return tuple(self._filters)

    def start_person(self, person: int, rgb: U8, box_xyxy_px: F64) -> bool:
        """Start or restart tracking a person at a box (left, top, right, bottom).

        Returns:
            False if the box is too small or outside of the image: the person is not tracked.
        """
        self.stop_person(person)
        left, top, right, bottom = np.asarray(box_xyxy_px, np.float64).tolist()
        box = np.array([(left + right) / 2, (top + bottom) / 2, right - left, bottom - top])
        if not np.all(np.isfinite(box)) or box[2:].min() < BOX_MIN_PX:
            return False
        height, width = rgb.shape[:2]
        if right < 1 or bottom < 1 or left > width - 1 or top > height - 1:
            return False
        state = np.zeros((self._config.particles, STATES))
        state[:, BOX] = box
        log_aspect = float(np.log(box[2] / box[3]))
        self._filters[person] = _BoxFilter((rgb, box), state, state, box, log_aspect, np.empty(0))
        return True

    def stop_person(self, person: int) -> None:
        """Stop tracking a person, if tracked."""
        self._filters.pop(person, None)

    def update_boxes(self, rgb: U8) -> Mapping[int, ColourEstimate]:
        """Return the boxes of all tracked people in the next frame, HxWx3."""
        filters = list(self._filters.values())
        if not filters:
            return {}
        for one in filters:
            if one.initial is not None:
                self._learn(one, *one.initial)
        previous = np.stack([one.states for one in filters])
        states = self._motion(previous, np.stack([f.previous for f in filters]), self._generator)
        boxes = states[..., BOX]
        patches = [self._patch(rgb, own) for own in boxes]
        weights = normalised_weights(
            np.stack(list(map(self._log_weights, filters, patches, boxes)))
        )
        estimates = np.einsum("pn,pns->ps", weights, states)
        chosen = resample_systematic(weights, self._generator)
        for k, one in enumerate(filters):
            one.states, one.previous = states[k, chosen[k]], previous[k, chosen[k]]
            one.box = estimates[k, BOX]
            if self._ratio is not None and one.model is not None:
                background = self._ratio.learn_colours(patches[k], one.box).background
                one.model = ColourModel(one.model.person, background)
        return self._estimates(patches, estimates)

    def _patch(self, rgb: U8, boxes: F64) -> HsvPatch:
        return hsv_patch(rgb, boxes if self._ratio is None else boxes * self._ratio.reach)

    def _learn(self, one: _BoxFilter, rgb: U8, box: F64) -> None:
        reference = self._histogram(rgb, box[None])[0]
        # The part of the box outside the image shows no colours of the person.
        one.reference = reference / max(reference.sum(), 1e-9)
        if self._ratio is not None:
            one.model = self._ratio.learn_colours(self._patch(rgb, box[None]), box)
        one.initial = None

    def _log_weights(self, one: _BoxFilter, patch: HsvPatch, boxes: F64) -> F64:
        if self._ratio is None or one.model is None:
            distances = self._histogram.measure_distances(patch, boxes, one.reference)
            return log_likelihoods(distances, self._config.sigma)
        scores = self._ratio.score_boxes(patch, boxes, one.model)
        # Mean over the pixels of the box: neighbouring pixels are not independent.
        logs = scores / (one.box[2] * one.box[3] * RATIO_SIGMA)
        stretch = np.log(boxes[:, 2] / boxes[:, 3]) - one.log_aspect
        return np.asarray(logs - 0.5 * (stretch / ASPECT_SIGMA) ** 2)

    def _estimates(self, patches: Sequence[HsvPatch], states: F64) -> dict[int, ColourEstimate]:
        estimates = {}
        for k, (person, one) in enumerate(self._filters.items()):
            centre, size = states[k, :2], states[k, SIZE]
            box = np.concatenate([centre - size / 2, centre + size / 2])
            # The estimate lies among the particles, so the patch covers it.
            (distance,) = self._histogram.measure_distances(
                patches[k], one.box[None], one.reference
            )
            estimates[person] = ColourEstimate(box, float(distance))
        return estimates
