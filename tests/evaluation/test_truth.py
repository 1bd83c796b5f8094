"""Truth at the stamps of frames, and flags of required people."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL
from evaluation.pool import Pool
from evaluation.recordings.ground_truth import read_truth, sample_truth
from evaluation.recordings.recordings import EvaluationRecording, plan_recordings, render_recording
from evaluation.recordings.visibility import load_views, save_views, simulated_views
from lab.catalogue import load_scenario
from lab.truth.motion_capture import capture, person_id
from lab.truth.silhouette import silhouettes
from lab.world import World
from people4d.errors import SourceError
from tests.evaluation import builders
from tests.lab.scenarios import DRIVE, FRAMES, write_scenario

pytestmark = pytest.mark.render

MS = 1_000_000


def test_truth_between_its_stamps() -> None:
    # ann walks from x = 2 to 3 between 100 and 200 ms: at 150 ms she is at 2.5.
    truths = [builders.truth(1, ann=(2.0, 0.0)), builders.truth(2, ann=(3.0, 0.0))]
    sampled = sample_truth(truths, [50 * MS, 150 * MS, 250 * MS], "it")
    before, between, after = sampled.frames
    assert before is None
    assert after is None
    assert between is not None
    np.testing.assert_allclose(between.people[0].position_m, [2.5, 0.0, 0.0])
    assert sampled.ids == ("ann",)
    assert not sampled.has_visibility


def test_a_second_round_of_a_recording_is_left_out() -> None:
    truths = [builders.truth(k, ann=(2.0, 0.0)) for k in (0, 1, 2)]
    truths += [builders.truth(k, ann=(9.0, 0.0)) for k in (0, 1, 2)]
    (frame,) = sample_truth(truths, [150 * MS], "it").frames
    assert frame is not None
    assert frame.people[0].position_m[0] == 2.0


def test_a_person_mostly_hidden_is_occluded() -> None:
    sampled = sample_truth([builders.truth(0, ann=(3.0, 0.0), bea=(4.0, 0.0))], [0], "it")
    (frame,) = sampled.frames
    assert frame is not None
    for share, occluded in ((0.34, True), (0.36, False)):
        detected = type(frame)(frame.people, frame.captured, {"ann": 1.0, "bea": share})
        truth = detected.ground_truth(builders.INFO, LINK_FROM_OPTICAL)
        assert truth.required.tolist() == [True, not occluded]
        assert truth.in_view.tolist() == [True, True]


def test_truth_in_two_frames_is_refused() -> None:
    other = builders.truth(1, ann=(2.0, 0.0))
    truths = [builders.truth(0, ann=(2.0, 0.0)), type(other)(**_fields(other), frame_id="odom")]
    with pytest.raises(SourceError, match="it has truth in the frames map, odom"):
        sample_truth(truths, [0], "it")


def _fields(message: object) -> dict[str, Any]:
    names = getattr(message, "__struct_fields__", ())
    return {name: getattr(message, name) for name in names if name != "frame_id"}


def test_truth_of_drawn_frames_has_the_visible_share_of_each_pixel(tmp_path: Path) -> None:
    (recording,) = plan_recordings([f"lab:{write_scenario(tmp_path)}"], [], "depth", tmp_path)
    render_recording(recording, 1, lambda *_: None)
    world = World(load_scenario(str(tmp_path / "walk.toml")))
    stamps_ns = [world.stamp_ns(k) for k in range(FRAMES)]
    with np.load(recording.truth_file) as file:
        shares, positions = file["vis"], file["pos"]
    sampled = read_truth(recording, stamps_ns)
    for row, frame in enumerate(sampled.frames):
        assert frame is not None
        assert list(frame.shares.values()) == pytest.approx(shares[row].tolist())
        positions_m = [person.position_m for person in frame.people]
        np.testing.assert_allclose(positions_m, positions[row], atol=1e-9)
        assert frame.map_from_camera is not None
        np.testing.assert_allclose(frame.map_from_camera, world.map_from_optical(row / 10))


def test_truth_of_a_folder_of_images_lies_in_it(shared: Path) -> None:
    folder = shared / "data" / "lab" / "two"
    with np.load(folder / "gt.npz") as file:
        times_s, positions, shares = file["t"], file["pos"], file["vis"]
    stamps_ns = np.round(times_s * 1e9).astype(int).tolist()
    frame = read_truth(EvaluationRecording("two", "two", folder), stamps_ns).frames[-1]
    assert frame is not None
    np.testing.assert_allclose([p.position_m for p in frame.people], positions[-1], atol=1e-9)
    assert list(frame.shares.values()) == pytest.approx(shares[-1].tolist())


def test_visible_shares_are_computed_without_rendering(tmp_path: Path) -> None:
    scenario = load_scenario(str(write_scenario(tmp_path, DRIVE)))
    world = World(scenario)
    stamps_ns = [world.stamp_ns(k) for k in range(FRAMES)]
    times_s = [world.frame_s(k) for k in range(FRAMES)]
    positions = [
        {person_id(k): capture(world, k, t_s).position_m for k in range(2)} for t_s in times_s
    ]
    views_of_camera = simulated_views(scenario, None, positions, stamps_ns)
    assert views_of_camera is not None
    for view, t_s in zip(views_of_camera, times_s, strict=True):
        pose = world.optical_from_map(t_s)
        outlines = silhouettes(world.keypoints_m(t_s), pose, world.info)
        assert view.shares == {person_id(k): one.visible_share for k, one in outlines.items()}
        np.testing.assert_array_equal(view.map_from_camera, world.map_from_optical(t_s))
    assert (
        min(view.shares["2"] for view in views_of_camera)
        < 0.8
        < max(view.shares["2"] for view in views_of_camera)
    )
    save_views(tmp_path / "views.npz", stamps_ns, views_of_camera)
    cached = load_views(tmp_path / "views.npz", stamps_ns)
    assert cached is not None
    assert [view.shares for view in cached] == [view.shares for view in views_of_camera]
    np.testing.assert_array_equal(cached[-1].map_from_camera, views_of_camera[-1].map_from_camera)
    assert load_views(tmp_path / "views.npz", stamps_ns[1:]) is None
    moved = [{name: position + 1.0 for name, position in row.items()} for row in positions]
    assert simulated_views(scenario, None, moved, stamps_ns) is None


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_the_order_of_the_work(jobs: int) -> None:
    finished: list[tuple[str, float]] = []
    wrong: list[Any] = [4, "no number"]
    with Pool(jobs, lambda stage, share: finished.append((stage, share))) as pool:
        assert pool.do("roots", math.sqrt, [16, 4, 36]) == [4.0, 2.0, 6.0]
        assert finished == [("roots", k / 3) for k in range(4)]
        with pytest.raises(TypeError):
            pool.do("roots", math.sqrt, wrong)
