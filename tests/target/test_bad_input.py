"""Missing and poor input leads to a clear state, never to another person."""

import math
from typing import Any

import numpy as np
import pytest

from people4d.messages import TargetCommand
from services.target.observe import uncovered_crops
from tests import builders
from tests.target.scene import BLUE, RED, Scene, followed

OTHERS = {2: (5.0, 2.0, BLUE), 7: (3.5, 0.5, RED)}


def test_new_track_is_not_locked_without_embeddings() -> None:
    """Without appearance neither the person beside nor a new one nearby replaces the person."""
    scene = followed(p2=(5, 2, BLUE))
    targets = [scene.frame(OTHERS, with_embeddings=False) for _ in range(100)]
    assert {target.state for target in targets} == {"searching", "lost"}
    assert all(target.id is None and target.stop for target in targets)
    assert targets[-1].reason.startswith("person 7 is the likeliest, with a probability of ")
    assert scene.node.status().counters["without_embeddings"] == 100
    scene.frame(OTHERS, with_embeddings=False, crops=0)
    assert scene.node.status().counters["without_embeddings"] == 100


def test_person_chosen_without_embeddings_is_lost_with_its_track() -> None:
    """Embeddings that arrive later show other people only, so no view of the person is known."""
    scene = Scene()
    scene.choose(id=1)
    scene.frames(10, {1: (3, 0, RED)}, with_embeddings=False)
    targets = [scene.frame(OTHERS) for _ in range(100)]
    assert {target.id for target in targets} == {None}
    assert targets[-1].state == "lost"
    assert targets[-1].reason == "no clear view of the person is known"


@pytest.mark.parametrize("tilt_deg", [20.0, 45.0])
def test_distance_from_a_tilted_camera_is_on_the_ground_of_the_base(tilt_deg: float) -> None:
    """Tracks are in the frame of a tilted camera; the base is level."""
    c, s = math.cos(math.radians(tilt_deg)), math.sin(math.radians(tilt_deg))
    tilt = np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]])
    scene = followed()
    scene.node.handle(builders.static_transform(tilt, "base_link"), 0)
    target = scene.frame({1: (3, 0, RED)})
    assert target.state == "locked"
    assert target.bearing_rad == pytest.approx(0)
    # The person is at (3, 0, 1) in the frame of the camera.
    assert target.distance_m == pytest.approx(abs(3 * c - s))


def test_nearest_person_without_a_transform_ends_without_a_person() -> None:
    scene = Scene()
    scene.choose("nearest")
    targets = [scene.frame({1: (3, 0, RED), 2: (5, 2, BLUE)}) for _ in range(60)]
    assert {target.id for target in targets} == {None}
    assert (targets[0].state, targets[-1].state) == ("searching", "none")
    assert all(target.stop for target in targets)


def test_tracks_in_another_frame_without_a_transform_need_appearance() -> None:
    """A change of the frame makes positions worthless; a person who differs is not locked."""
    scene = followed(p2=(5, 2, BLUE))
    targets = [scene.frame({2: (3, 0, BLUE)}, frame_id="odom") for _ in range(60)]
    assert all(target.id is None and target.stop for target in targets)
    assert targets[-1].distance_m is None


def test_people_without_joints_are_followed_and_not_confused() -> None:
    """Detections without keypoints and depth still have crops."""
    scene = followed(p2=(5, 2, BLUE))
    people = {1: (3.0, 0.0, RED), 2: (5.0, 2.0, BLUE)}
    assert scene.frames(10, people).id == 1
    assert {scene.frame({2: (5, 2, BLUE)}).id for _ in range(60)} == {None}


@pytest.mark.parametrize(("absence", "state"), [(30, "locked"), (60, "none")])
def test_person_absent_at_the_start_is_locked_only_in_time(absence: int, state: str) -> None:
    """The choice waits for 5 s; frames are 0.1 s apart."""
    scene = Scene()
    scene.choose(id=5)
    targets = [scene.frame({}) for _ in range(absence)]
    assert targets[0].reason == "person 5 is not in view"
    assert all(target.id is None and target.stop for target in targets)
    assert scene.frame({5: (3, 0, RED)}).state == state


@pytest.mark.parametrize(
    ("action", "fields"), [("nearest", {}), ("at", {"position_m": np.array([3.0, 0.0])})]
)
def test_choice_in_an_empty_room_ends_with_its_reason(
    action: str, fields: dict[str, np.ndarray]
) -> None:
    scene = Scene()
    scene.node.handle(builders.static_transform(np.eye(4), "base_link"), 0)
    scene.choose(action, **fields)
    targets = [scene.frame({}) for _ in range(60)]
    assert targets[0].state == "searching"
    assert targets[-1].reason.startswith("no person is chosen: no person is in view")


def test_last_of_two_choosers_between_two_frames_is_in_force() -> None:
    scene = Scene()
    people = {1: (3.0, 0.0, RED), 2: (5.0, 2.0, BLUE)}
    scene.frame(people)
    scene.choose(id=1, chooser="planner")
    scene.choose(id=2, chooser="operator")
    targets = [scene.frame(people) for _ in range(10)]
    assert {(target.id, target.chooser) for target in targets} == {(2, "operator")}
    assert scene.node.status().counters["replaced_choices"] == 1


def test_clock_step_ahead_confirms_the_person_by_appearance() -> None:
    """Tracks may exchange their people in the gap of the stamps, though their numbers go on."""
    scene = followed(p2=(5, 2, BLUE))
    scene.stamp_ns += 3_600_000_000_000
    after = [scene.frame({1: (3, 0, BLUE), 2: (5, 2, RED)}) for _ in range(20)]
    assert {target.id for target in after} <= {None, 2}
    assert after[-1].id == 2


def test_choice_that_waits_outlives_a_clock_reset_and_ends() -> None:
    scene = Scene(stamp_ns=100_000_000_000)
    scene.choose(id=5)
    scene.frames(30, {})
    scene.stamp_ns -= 50_000_000_000
    assert scene.frames(49, {}).state == "searching"
    assert scene.frames(5, {}).state == "none"


@pytest.mark.parametrize(("left_px", "uncovered"), [(30, []), (200, [0, 1])])
def test_overlapping_crops_without_depth_do_not_count(left_px: int, uncovered: list[int]) -> None:
    """Without depth either person may cover the other one."""
    boxes = ([20, 50, 80, 300], [left_px, 50, left_px + 60, 300])
    people = [
        builders.detection(box_xyxy_px=np.array(box, np.float32), position_m=None) for box in boxes
    ]
    assert uncovered_crops(people) == uncovered


@pytest.mark.parametrize(
    "fields",
    [
        {"action": "dance"},
        {"action": "id", "id": "7"},
        {"action": "id", "id": 1.5},
        {"action": "id", "id": True},
        {"action": "at", "position_m": [1.0, 2.0]},
        {"action": "name", "name": 5},
        {"action": "none", "chooser": 3},
    ],
)
def test_command_with_a_wrong_type_is_refused(fields: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"^\w+: "):
        TargetCommand(stamp_ns=0, sequence=0, **fields)
