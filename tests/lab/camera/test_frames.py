"""Frames of a plain camera: drifting exposure, blur, tilt, depth that is late."""

import math

import numpy as np
import pytest
from msgspec import structs

from lab.camera.frames import FrameRenderer, RenderSettings
from lab.camera.image_drift import ImageDrift
from lab.camera.plan import CameraPlan, ImagePlan
from lab.catalogue import load_scenario
from lab.scenario import Scenario
from lab.world import World, camera_info
from people4d.messages import U8
from tests.lab.scenarios import write_scenario

pytestmark = pytest.mark.render


@pytest.fixture(name="walk", scope="module")
def walk_fixture(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    return load_scenario(str(write_scenario(tmp_path_factory.mktemp("walk"))))


def renderer(scenario: Scenario, **camera: object) -> FrameRenderer:
    plan = structs.replace(scenario.camera, **camera)
    settings = RenderSettings(samples=1, errors=False)
    return FrameRenderer(World(structs.replace(scenario, camera=plan)), settings)


def image(scenario: Scenario, index: int = 6, **camera: object) -> U8:
    drawn = renderer(scenario, **camera)
    return drawn.rgb(index, drawn.view(index))


def test_exposure_and_white_balance_drift_with_the_given_spread() -> None:
    plan = ImagePlan(exposure_stops=0.4, white_balance=0.1)
    gains = np.array([ImageDrift(plan, seed).at(1.0).gains for seed in range(400)])
    stops = np.log2(gains[:, 1])
    assert stops.std() == pytest.approx(0.4, rel=0.12)
    for channel in (0, 2):
        ratio = np.log(gains[:, channel] / gains[:, 1])
        assert ratio.std() == pytest.approx(0.1, rel=0.12)
        assert abs(ratio.mean()) < 0.02


def test_drift_is_slow_and_depends_on_seed_and_time_only() -> None:
    plan = ImagePlan(exposure_stops=0.4)
    one = ImageDrift(plan, 5)
    gains = [one.at(t_s).gains[1] for t_s in np.arange(0, 20, 0.1)]
    assert np.abs(np.diff(np.log2(gains))).max() < 0.08
    assert np.ptp(np.log2(gains)) > 0.3
    assert ImageDrift(plan, 5).at(7.3) == one.at(7.3)
    assert ImageDrift(plan, 6).at(7.3) != one.at(7.3)


def test_longer_exposure_brightens_and_grain_roughens(walk: Scenario) -> None:
    usual = image(walk).astype(float)
    bright = image(walk, image=ImagePlan(brightness=2.0)).astype(float)
    assert bright.mean() > usual.mean() + 20
    noisy = image(walk, image=ImagePlan(grain=6.0)).astype(float)
    difference = (noisy - usual)[..., 1]
    assert abs(difference.mean()) < 1.5
    assert difference.std() > 5


def test_out_of_focus_image_has_weaker_edges(walk: Scenario) -> None:
    sharp, blurred = (
        np.abs(np.diff(image(walk, image=plan).astype(float), axis=1)).mean()
        for plan in (ImagePlan(grain=0.01), ImagePlan(grain=0.01, blur_px=1.5))
    )
    assert blurred < 0.7 * sharp


def test_motion_blurs_people_and_not_the_room(walk: Scenario) -> None:
    usual, blurred = image(walk), image(walk, exposure_s=0.1)
    drawn = renderer(walk)
    people = [drawn.view(index).owners > 0 for index in (5, 6, 7)]
    moving, room = np.any(people, axis=0), ~np.any(people, axis=0)
    difference = np.abs(blurred.astype(float) - usual).mean(axis=-1)
    assert difference[room].mean() < 0.5
    assert difference[moving].mean() > 4 * max(difference[room].mean(), 0.5)


def test_roll_turns_the_image(walk: Scenario) -> None:
    level, rolled = (
        World(structs.replace(walk, camera=structs.replace(walk.camera, roll_deg=roll)))
        for roll in (0.0, 20.0)
    )
    # The right side goes down, so the map's up direction leans to the left in the image.
    up = [of.optical_from_map(0.0)[:3, :3] @ (0, 0, 1) for of in (level, rolled)]
    assert math.atan2(up[0][0], -up[0][1]) == pytest.approx(0.0, abs=1e-9)
    assert math.degrees(math.atan2(up[1][0], -up[1][1])) == pytest.approx(-20.0, abs=0.5)


def test_late_depth_shows_where_people_were(walk: Scenario) -> None:
    late, usual = renderer(walk, depth_lag_s=0.1), renderer(walk)
    before = usual.view(5)  # one frame of 0.1 s earlier
    expected = usual.depth_mm(5, before)
    assert np.array_equal(late.depth_mm(6, late.view(6)), expected)
    assert not np.array_equal(usual.depth_mm(6, usual.view(6)), expected)
    assert np.array_equal(late.view(6).owners, usual.view(6).owners)


def test_depth_sensor_of_the_plan_is_used(walk: Scenario) -> None:
    plan = structs.replace(walk.camera, depth_sensor="xtion")
    world = World(structs.replace(walk, camera=plan))
    frames = [FrameRenderer(world, RenderSettings(colour="flat")) for _ in range(2)]
    one, two = (f.depth_mm(3, f.view(3)) for f in frames)
    assert np.array_equal(one, two)
    usual = FrameRenderer(World(walk), RenderSettings(colour="flat"))
    assert not np.array_equal(one, usual.depth_mm(3, usual.view(3)))
    assert camera_info(CameraPlan()).max_depth_m == 5.0
