"""Ratios of pixels by hand, and the compiled way against the plain one."""

import numpy as np
import pytest

from people4d.messages import F64, U8
from services.gait.colour.config import ColourLayerConfig
from services.gait.colour.histogram import HueSaturation, part_of
from services.gait.colour.pixel_ratios import Colours, PixelRatios, grid_of
from tests.gait.numpy_colours import scores

RED, GREEN = 19, 139  # bins of full saturation, hue * 20 + saturation
CONFIG = ColourLayerConfig(bands=1)


def ratios_of(config: ColourLayerConfig = CONFIG) -> PixelRatios:
    return PixelRatios(config, HueSaturation(20, 20, config.points))


def scene() -> tuple[U8, F64]:
    """A red person of 40 x 100 pixels before a green wall, and the box."""
    rgb = np.zeros((200, 200, 3), np.uint8)
    rgb[..., 1] = 255
    rgb[50:150, 80:120] = (255, 0, 0)
    return rgb, np.array([100.0, 100.0, 40.0, 100.0])


def test_ratios_by_hand() -> None:
    # Half of the person is red, and a hundredth of what is about them: 0.5003 / 0.0103 = 48.6, but
    # no pixel says more than 10. Green: 0.5003 / 0.9903. What is in neither: 1.
    person, around = np.zeros((1, 3)), np.array([0.01, 0.99, 0.0])
    person[0, :2] = 0.5
    assert Colours(person, around).ratios[0] == pytest.approx([10.0, 0.5003 / 0.9903, 1.0])


def test_the_middle_is_the_persons_and_the_outside_is_not() -> None:
    # tenths of 8 exp(-(u / wide)^4): 8 in the middle; at the side of the body, 0.5 of the width,
    # exp(-(0.5 / 0.4)^4) = 0.087: 1 in 10; beside the head (0.2) 0. Outside of the box 0.
    grid = grid_of((41, 41), (2.0, 1.5), 4)
    assert grid.tenths[20, 20] == 8
    body, head = 20, int(np.argmin(np.abs(grid.v + 0.4)))
    side = int(np.argmin(np.abs(grid.u - 0.49)))
    assert grid.tenths[body, side] == 1
    assert grid.tenths[head, side] == 0
    assert not grid.tenths[np.abs(grid.v) > 0.5].any()
    assert not grid.tenths[:, np.abs(grid.u) > 0.5].any()
    assert [int(grid.bands[np.argmin(np.abs(grid.v - v))]) for v in (-0.45, -0.1, 0.1, 0.45)] == [
        *range(4)
    ]


def test_a_person_is_told_from_the_wall() -> None:
    rgb, box = scene()
    ratios = ratios_of()
    colours = ratios.learn(part_of(rgb, (box * ratios.reach)[None]), box)
    assert colours.person[0, RED] == pytest.approx(1.0)
    assert colours.around[GREEN] > 0.6  # the rest is red beside the middle of the box
    boxes = np.array([box, [*(150, 100), 40, 100], [*(100, 100), 20, 50], [*(100, 100), 80, 200]])
    own, beside, within, beyond = ratios.scores(part_of(rgb, boxes), boxes, colours)
    assert own > max(beside, within, beyond)
    assert beside < 0


def test_each_height_has_its_own_colours() -> None:
    # Upside down a person has the same histogram.
    rgb, box = scene()
    rgb[50:100, 80:120] = (0, 0, 255)
    turned = rgb.copy()
    turned[50:150] = rgb[149:49:-1]
    for bands, alike in ((1, True), (4, False)):
        ratios = ratios_of(ColourLayerConfig(bands=bands))
        colours = ratios.learn(part_of(rgb, (box * ratios.reach)[None]), box)
        (upright,) = ratios.scores(part_of(rgb, box[None]), box[None], colours)
        (other,) = ratios.scores(part_of(turned, box[None]), box[None], colours)
        assert (other > 0.8 * upright) == alike


def test_nothing_speaks_for_what_lies_outside_of_the_image() -> None:
    rgb, box = scene()
    ratios = ratios_of()
    colours = ratios.learn(part_of(rgb, (box * ratios.reach)[None]), box)
    outside = np.array([[900.0, 900.0, 40.0, 100.0]])
    assert ratios.scores(part_of(rgb, outside), outside, colours).tolist() == [0.0]
    nothing = ratios.learn(part_of(rgb, outside), outside[0])
    assert not nothing.person.any()
    assert (nothing.ratios == 1).all()


def test_compiled_scores_are_those_of_the_plain_way() -> None:
    chance = np.random.default_rng(3)
    rgb = chance.integers(0, 255, (120, 160, 3), np.uint8)
    boxes = np.concatenate([chance.uniform(-40, 200, (60, 2)), chance.uniform(4, 150, (60, 2))], 1)
    config = ColourLayerConfig()
    bins = HueSaturation(20, 20, config.points)
    ratios = PixelRatios(config, bins)
    box = np.array([55.0, 65.0, 70.0, 90.0])
    colours = ratios.learn(part_of(rgb, (box * ratios.reach)[None]), box)
    plain = scores(rgb, boxes, colours, grid_of(config.points, (1.0, 1.0), config.bands), bins)
    np.testing.assert_allclose(ratios.scores(part_of(rgb, boxes), boxes, colours), plain, atol=1e-6)
