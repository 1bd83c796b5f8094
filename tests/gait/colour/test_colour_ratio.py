"""Colour ratios by hand, and compiled scores against NumPy."""

import numpy as np
import pytest

from people4d.messages import F64, U8
from services.gait.colour.colour_ratio import ColourModel, ColourRatio, person_prior
from services.gait.colour.histogram import SAMPLES, HueSaturationHistogram, hsv_patch, sample_grid
from tests.gait.numpy_histogram import scores

RED, GREEN = 19, 139  # bins of full saturation, hue * 20 + saturation


def ratio_of(bands: int = 1) -> ColourRatio:
    return ColourRatio(HueSaturationHistogram(), bands)


def scene() -> tuple[U8, F64]:
    """A red person of 40 x 100 pixels before a green wall, and the box."""
    rgb = np.zeros((200, 200, 3), np.uint8)
    rgb[..., 1] = 255
    rgb[50:150, 80:120] = (255, 0, 0)
    return rgb, np.array([100.0, 100.0, 40.0, 100.0])


def test_ratios_by_hand() -> None:
    # Half of the person is red, and a hundredth of the surroundings: the ratio 0.5003 / 0.0103 =
    # 48.6 is limited to 10. Green: 0.5003 / 0.9903. A colour in neither: 1.
    person, background = np.zeros((1, 3)), np.array([0.01, 0.99, 0.0])
    person[0, :2] = 0.5
    assert ColourModel(person, background).ratios[0] == pytest.approx([10.0, 0.5003 / 0.9903, 1.0])


def test_sample_probability_falls_from_the_middle_to_the_sides() -> None:
    # tenths of 8 exp(-(u / wide)^4): 8 in the middle; at the side of the body, 0.5 of the width,
    # exp(-(0.5 / 0.4)^4) = 0.087: 1 in 10; next to the head (0.2) 0. Outside of the box 0.
    grid = sample_grid((41, 41), (2.0, 1.5))
    prior = person_prior(grid, 4)
    assert prior.tenths[20, 20] == 8
    body, head = 20, int(np.argmin(np.abs(grid.v + 0.4)))
    side = int(np.argmin(np.abs(grid.u - 0.49)))
    assert prior.tenths[body, side] == 1
    assert prior.tenths[head, side] == 0
    assert not prior.tenths[np.abs(grid.v) > 0.5].any()
    assert not prior.tenths[:, np.abs(grid.u) > 0.5].any()
    assert [int(prior.bands[np.argmin(np.abs(grid.v - v))]) for v in (-0.45, -0.1, 0.1, 0.45)] == [
        *range(4)
    ]


@pytest.mark.slow
def test_box_of_the_person_scores_best() -> None:
    rgb, box = scene()
    ratios = ratio_of()
    model = ratios.learn_colours(hsv_patch(rgb, (box * ratios.reach)[None]), box)
    assert model.person[0, RED] == pytest.approx(1.0)
    assert model.background[GREEN] > 0.6  # the rest is red outside the middle of the box
    boxes = np.array([box, [*(150, 100), 40, 100], [*(100, 100), 20, 50], [*(100, 100), 80, 200]])
    own, beside, within, beyond = ratios.score_boxes(hsv_patch(rgb, boxes), boxes, model)
    assert own > max(beside, within, beyond)
    assert beside < 0


def test_bands_distinguish_an_inverted_person() -> None:
    # Upside down a person has the same histogram.
    rgb, box = scene()
    rgb[50:100, 80:120] = (0, 0, 255)
    turned = rgb.copy()
    turned[50:150] = rgb[149:49:-1]
    for bands, similar in ((1, True), (4, False)):
        ratios = ratio_of(bands)
        model = ratios.learn_colours(hsv_patch(rgb, (box * ratios.reach)[None]), box)
        (upright,) = ratios.score_boxes(hsv_patch(rgb, box[None]), box[None], model)
        (other,) = ratios.score_boxes(hsv_patch(turned, box[None]), box[None], model)
        assert (other > 0.8 * upright) == similar


def test_box_outside_of_the_image_scores_zero() -> None:
    rgb, box = scene()
    ratios = ratio_of()
    model = ratios.learn_colours(hsv_patch(rgb, (box * ratios.reach)[None]), box)
    outside = np.array([[900.0, 900.0, 40.0, 100.0]])
    assert ratios.score_boxes(hsv_patch(rgb, outside), outside, model).tolist() == [0.0]
    nothing = ratios.learn_colours(hsv_patch(rgb, outside), outside[0])
    assert not nothing.person.any()
    assert (nothing.ratios == 1).all()


def test_compiled_scores_equal_numpy() -> None:
    generator = np.random.default_rng(3)
    rgb = generator.integers(0, 255, (120, 160, 3), np.uint8)
    boxes = np.concatenate(
        [generator.uniform(-40, 200, (60, 2)), generator.uniform(4, 150, (60, 2))], 1
    )
    histogram = HueSaturationHistogram()
    ratios = ColourRatio(histogram)
    box = np.array([55.0, 65.0, 70.0, 90.0])
    model = ratios.learn_colours(hsv_patch(rgb, (box * ratios.reach)[None]), box)
    plain = scores(rgb, boxes, model, sample_grid(SAMPLES), histogram)
    np.testing.assert_allclose(
        ratios.score_boxes(hsv_patch(rgb, boxes), boxes, model), plain, atol=1e-6
    )
