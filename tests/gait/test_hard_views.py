"""People in difficult views: from depth and keypoints of the lab to steps."""

from collections import Counter
from collections.abc import Sequence

import numpy as np
import pytest

from lab.camera.plan import CameraPlan
from lab.drawing.renderer import draw_depth
from lab.scenario import PersonPlan, Scenario, Waypoint
from lab.truth.frames import person_views
from lab.truth.motion_capture import footfalls
from lab.world import World
from people4d.messages import PersonGait
from services.gait.cascade import PersonObservation
from services.gait.config import GaitConfig
from services.gait.estimator import ESTIMATOR_COUNTERS, GaitEstimator, GaitFrame

RATE_HZ = 10.0
CONFIDENCE = 0.8  # of a visible keypoint
FEET = ("left_foot", "right_foot")
TO_AND_FRO = PersonPlan(
    body="carlos",
    start=(4.9, 0.3),
    path=(Waypoint(to=(2.9, 0.1)), Waypoint(to=(4.9, -0.1))),
    repeat=True,
)


def world_of(*people: PersonPlan, duration_s: float, pitch_deg: float = 3.0) -> World:
    camera = CameraPlan(pitch_deg=pitch_deg, width=320, height=240, focal_px=307.0)
    return World(
        Scenario(about="A test.", duration_s=duration_s, room="hall", camera=camera, people=people)
    )


def gait(world: World, begin_s: float = 0.0) -> list[list[PersonGait]]:
    """Return the people in each frame, by perfect depth, boxes and keypoints."""
    estimator = GaitEstimator(
        GaitConfig(), world.info, Counter(dict.fromkeys(ESTIMATOR_COUNTERS, 0))
    )
    rgb = np.full((world.info.height, world.info.width, 3), 128, np.uint8)
    found = []
    for t_s in np.arange(begin_s, world.scenario.duration_s, 1 / RATE_HZ).tolist():
        pose, meshes = world.optical_from_map(t_s), world.meshes(t_s)
        view = draw_depth([world.room.mesh, *meshes], pose, world.info, baseline_m=0.05)
        depth_mm = np.where(np.isfinite(view.depth_m), 1000 * view.depth_m, 0).astype(np.uint16)
        observations = []
        for k, person in enumerate(person_views(world, t_s, view, meshes)):
            confidence = CONFIDENCE * person.visible.astype(bool)
            keypoints = np.nan_to_num(np.column_stack([person.keypoints_px, confidence]))
            depth_m = float((pose @ np.append(person.position_m, 1.0))[2])
            observations.append(
                PersonObservation(k + 1, person.box_xyxy_px, keypoints.astype(np.float32), depth_m)
            )
        frame = GaitFrame(
            round(t_s * 1e9), rgb, depth_mm, observations, world.map_from_optical(t_s)
        )
        results = estimator.update_people(frame)
        assert results is not None
        found.append([one.person for one in sorted(results, key=lambda one: one.person.id)])
    return found


def states(people: Sequence[Sequence[PersonGait]], names: Sequence[str]) -> list[str]:
    return [p.state for frame in people for one in frame for p in one.points if p.name in names]


def test_feet_below_the_image_are_neither_measured_nor_do_they_step() -> None:
    # The camera looks up by 12 degrees: knees and feet are below the image all the time.
    people = gait(world_of(TO_AND_FRO, duration_s=3.0, pitch_deg=-12.0))
    assert "measured" not in states(people, FEET)
    assert all(one.measures.steps == 0 for frame in people for one in frame)
    assert "measured" in states(people, ["head"])


def test_person_who_sits_down_has_no_measures() -> None:
    path = (Waypoint(to=(3.4, 0.5), stop_s=6.0, face_deg=180, sit=True),)
    world = world_of(PersonPlan(body="george", start=(3.4, 0.5), path=path), duration_s=3.5)
    # Two short steps back to the stool, of 0.64 and 1.44 s, before the person sits.
    steps = [one.measures.steps for (one,) in gait(world)]
    assert max(steps) <= len(footfalls(world, 0)) == 2


def test_standing_person_has_no_step() -> None:
    path = (Waypoint(to=(3.6, -0.4), stop_s=9.0, face_deg=170, turn_head=True),)
    world = world_of(PersonPlan(body="hana", start=(3.6, -0.4), path=path), duration_s=2.5)
    assert {one.measures.steps for (one,) in gait(world)} == {0}


def test_two_people_in_step_side_by_side_have_the_same_measures() -> None:
    # Both take steps of 0.65 s at the same times, 0.8 m apart.
    people = [
        PersonPlan(body="carlos", start=(6.4, y_m), path=(Waypoint(to=(2.9, y_m)),))
        for y_m in (0.5, -0.5)
    ]
    for one in gait(world_of(*people, duration_s=4.0))[-1]:
        assert 4 <= one.measures.steps <= 6
        assert one.measures.cadence_per_min == pytest.approx(60 / 0.65, rel=0.15)


def test_recording_that_begins_in_a_step_has_no_step_more() -> None:
    world = world_of(TO_AND_FRO, duration_s=3.0)
    begin_s = 1.05  # the foot that lands at 1.37 s swings
    (last,) = gait(world, begin_s)[-1]
    landed = [fall for fall in footfalls(world, 0) if begin_s < fall.time_s < 2.8]
    assert last.measures.steps <= len(landed)
