"""Rendered candidates: their labels agree with their images."""

import numpy as np
import pytest

from common.geometry.transforms import apply
from people4d.messages import F64, U16
from scripts.render_bodies.__main__ import counts
from scripts.render_bodies.boxes import detector_box, layer_depths
from scripts.render_bodies.candidates import Samples, samples_of_scene
from scripts.render_bodies.detected import CONTENTS, draw_world, near_people, samples_of_room
from scripts.render_bodies.labels import MARGIN_PX, PERSON_MIN, PIXEL_M, Kind
from scripts.render_bodies.postures import draw_postures
from scripts.render_bodies.scenes import flatten
from scripts.render_people.views import MOTION_S, make_stage
from services.detector.config import DetectorConfig
from services.detector.models.registry import load_model
from services.detector.position.body import REACH_M, REFERENCE_M, SIZE_M, SIZE_PX
from services.tracker.motion import lifecycle

FULL: F64 = np.array([20.0, 10.0, 60.0, 110.0])


@pytest.fixture(scope="module")
def samples() -> Samples:
    rng = np.random.default_rng(3)
    found = list(samples_of_scene(rng, make_stage(rng, cuts=2, rooms=1), images=4))
    return Samples(*map(np.concatenate, zip(*found, strict=True)))


def test_pixels_are_those_of_the_network() -> None:
    assert pytest.approx((PIXEL_M, PIXEL_M)) == np.divide(SIZE_M, SIZE_PX)


def test_minimum_of_people_is_that_of_the_tracker() -> None:
    assert PERSON_MIN == lifecycle.PERSON_MIN


@pytest.mark.render
@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind"), [("poster", Kind.FLAT_FIGURE), ("people", Kind.PERSON)])
def test_detections_in_a_room_have_the_label_of_its_content(name: str, kind: Kind) -> None:
    found = samples_of_room(CONTENTS[name], 1001, load_model(DetectorConfig()))
    samples = next(one for one in found if len(one.kinds))
    assert (samples.kinds == kind).all()
    assert np.isnan(samples.offsets_m).all()
    # The mask is the detector's layer of depth, at the reference point in row 17, column 19.
    masks = samples.depths[:, 0, 15:20, 17:21] / 127
    assert (masks.mean(axis=(1, 2)) > 0.5).all()


def test_rooms_hold_their_content_only() -> None:
    things = draw_world(CONTENTS["screen"], 1000).scenario
    assert ([one.kind for one in things.objects], things.people) == (["screen"] * 2, ())
    empty = draw_world(CONTENTS["furniture"], 1000).scenario
    assert (empty.objects, empty.people) == ((), ())
    assert empty.furniture
    assert draw_world(CONTENTS["people"], 1000).scenario.people


@pytest.mark.slow
def test_points_before_a_torso_are_near_people_at_any_height() -> None:
    # A layer is 0.12 m before the middle of the torso; 0.35 m further is no longer a person.
    world = draw_world(CONTENTS["people"], 1000)
    joints_m = world.keypoints_m(1.0)[0][[5, 6, 11, 12]].mean(axis=0)
    torso_m = apply(world.optical_from_map(1.0), joints_m)
    shifts_m = [(0, 0, -0.12), (0.3, 0.4, -0.12), (0, 0, -0.46), (0, 0, -0.48), (0, 0, -3)]
    near = near_people(world, 1.0, torso_m + np.array(shifts_m))
    np.testing.assert_array_equal(near, [True, True, True, False, False])


@pytest.mark.render
@pytest.mark.slow
def test_images_have_margins_and_labels(samples: Samples) -> None:
    count = len(samples.kinds)
    size_px = (SIZE_PX[0] + 2 * MARGIN_PX, SIZE_PX[1] + 2 * MARGIN_PX)
    assert samples.colours.shape == (count, 3, *size_px)
    assert samples.depths.shape == (count, 4, *size_px)
    has_body = np.isin(samples.kinds, (Kind.FURNITURE, Kind.EMPTY), invert=True)
    np.testing.assert_array_equal(np.isfinite(samples.offsets_m).all(axis=1), has_body)
    assert has_body.any()
    assert not has_body.all()
    assert counts(samples).startswith(f"{count} candidates: ")


@pytest.mark.render
@pytest.mark.slow
def test_offsets_of_people_point_into_their_torso(samples: Samples) -> None:
    # The surface at the pixel of the torso's middle is half a torso nearer, 0.06 to 0.2 m.
    behind_m = []
    for k in np.flatnonzero((samples.kinds == Kind.PERSON) & (samples.shares > 0.9)):
        right_m, down_m, along_m = samples.offsets_m[k].tolist()
        row = MARGIN_PX + int((REFERENCE_M + down_m) / PIXEL_M)
        column = MARGIN_PX + int((SIZE_M[1] / 2 + right_m) / PIXEL_M)
        if 0 <= row < samples.depths.shape[2] and 0 <= column < samples.depths.shape[3]:
            _, relative, _, read = samples.depths[k, :, row, column] / 127
            if read == 1:
                behind_m.append(along_m - relative * REACH_M)
    assert len(behind_m) >= 5
    assert 0.04 < np.median(behind_m) < 0.22
    assert np.mean(np.abs(np.array(behind_m) - 0.12) < 0.2) > 0.8


@pytest.mark.render
@pytest.mark.slow
def test_persons_are_within_reach_of_their_layer(samples: Samples) -> None:
    along_m = samples.offsets_m[samples.kinds == Kind.PERSON, 2]
    assert np.abs(along_m - 0.12).max() <= 0.6
    others_m = samples.offsets_m[samples.kinds == Kind.OTHER_LAYER, 2]
    assert (np.abs(others_m - 0.12) > 0.6).all()


def test_layers_are_the_dense_depths_of_plausible_height() -> None:
    # 60 px at 100 px: 0.6 m a metre; at 5 m the box would be 3 m high.
    depth_mm: U16 = np.zeros((120, 80), np.uint16)
    depth_mm[:, :40], depth_mm[:, 40:] = 1500, 3000
    box_px = np.array([20.0, 20.0, 60.0, 80.0])
    assert layer_depths(depth_mm, box_px, 100.0) == pytest.approx([1.5, 3.0])
    depth_mm[:, 40:] = 5000
    assert layer_depths(depth_mm, box_px, 100.0) == pytest.approx([1.5])
    assert layer_depths(np.zeros_like(depth_mm), box_px, 100.0) == []


def test_boxes_of_detectors_stay_in_the_image_and_mostly_around_the_person() -> None:
    rng = np.random.default_rng(1)
    boxes = np.array([detector_box(rng, FULL, FULL, [], (80, 120)) for _ in range(200)])
    assert (boxes >= 0).all()
    assert (boxes <= [80, 120, 80, 120]).all()
    np.testing.assert_allclose(np.median(boxes, axis=0), FULL, atol=2)
    # Eight of a hundred are cut off at the bottom, by a fifth at least.
    assert 0.03 < np.mean(boxes[:, 3] < 95) < 0.2


def test_flat_figures_stay_on_their_rays_near_one_plane() -> None:
    rng = np.random.default_rng(5)
    body_m = rng.normal([0.0, 0.0, 3.0], 0.2, (50, 3))
    flat_m = flatten(body_m, np.eye(4), slope=0.0)
    np.testing.assert_allclose(flat_m[:, :2] / flat_m[:, 2:], body_m[:, :2] / body_m[:, 2:])
    assert np.ptp(flat_m[:, 2]) < 0.03 * np.ptp(body_m[:, 2])


@pytest.mark.slow
def test_bodies_of_later_parts_sit_and_lie() -> None:
    rng = np.random.default_rng(4)
    motion = draw_postures(rng, make_stage(rng, cuts=1, rooms=1).bodies[0])
    heights_m = [motion.at(t_s).map_from_pelvis[2, 3] for t_s in np.arange(0.0, MOTION_S, 0.25)]
    assert max(heights_m) > 0.7
    assert min(heights_m) < 0.5
