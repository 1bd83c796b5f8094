"""Scenes of people who walk in several styles."""

from benchmarks.gait_styles import HALVES, STYLES, scene


def test_each_half_has_all_styles_with_other_bodies_and_cameras() -> None:
    scenes = {half: [scene(seed) for seed in seeds] for half, seeds in HALVES.items()}
    for found in scenes.values():
        assert sorted(name for _, names in found for name in names) == sorted(STYLES)
    heights = {one.camera.at[2] for found in scenes.values() for one, _ in found}
    assert len(heights) == sum(map(len, HALVES.values()))
    assert min(heights) >= 0.4
    assert max(heights) <= 2.4


def test_same_seed_gives_the_same_scene() -> None:
    assert scene(1) == scene(1) != scene(2)
