"""The chosen person is kept, re-identified, and never confused with another person."""

import pytest

from services.target.build import build
from services.target.config import TargetConfig
from tests.target.scene import BLUE, GREEN, RED, Scene, followed

FAR = (6.0, 3.0)


def test_no_person_is_chosen_at_first() -> None:
    target = Scene().frame({1: (3, 0, RED)})
    assert (target.state, target.id, target.stop) == ("none", None, True)
    assert target.reason == "no person is chosen"


def test_chosen_person_is_locked_at_once() -> None:
    scene = Scene()
    scene.choose(id=2)
    target = scene.frame({1: (3, 0, RED), 2: (5, 2, BLUE)})
    assert (target.state, target.id, target.stop) == ("locked", 2, False)
    # The prior of a chosen track: log odds of 6. No view is known to compare the crop with.
    assert target.probability == pytest.approx(0.9975)


def test_person_is_locked_without_appearance_while_its_track_goes_on() -> None:
    scene = Scene()
    scene.choose(id=1)
    assert scene.frames(100, {1: (3, 0, RED)}, with_embeddings=False).state == "locked"


def test_hidden_person_is_occluded_then_searched_then_lost() -> None:
    scene = followed()
    states = [scene.frame({1: (3, 0, RED)}, hidden=[1]).state for _ in range(70)]
    # Visible for 0.15 s more, occluded until 2 s after the last lock, lost 5 s after it.
    assert states[:21] == ["locked"] + 20 * ["occluded"]
    assert set(states[21:51]) == {"searching"}
    assert set(states[51:]) == {"lost"}


def test_returning_person_with_a_new_track_is_recognised_within_a_second() -> None:
    scene = followed(p2=(5, 2, BLUE))
    scene.frames(30, {2: (5, 2, BLUE)})
    states = [scene.frame({2: (5, 2, BLUE), 7: (2, 1, RED)}) for _ in range(10)]
    locked = next(target for target in states if target.state == "locked")
    assert (locked.id, locked.reason) == (7, "recognised by appearance")


def test_another_person_is_never_locked_after_the_person_has_left() -> None:
    scene = followed(p2=(5, 2, BLUE))
    people = {2: (5.0, 2.0, BLUE), 7: (2.0, 1.0, GREEN)}
    targets = [scene.frame(people) for _ in range(100)]
    assert {target.state for target in targets} == {"searching", "lost"}
    assert all(target.id is None and target.stop for target in targets)


def test_person_visible_beside_is_not_locked_even_if_alike() -> None:
    scene = followed(p2=(5, 2, RED))
    states = {scene.frame({2: (5, 2, RED)}).state for _ in range(100)}
    assert states == {"searching", "lost"}


def test_alike_person_with_a_new_track_is_not_locked() -> None:
    scene = followed(p2=(5, 2, RED))
    scene.frames(30, {})
    states = {scene.frame({7: (4, 1, RED)}).state for _ in range(100)}
    assert states == {"searching", "lost"}


def test_alike_person_of_another_height_is_not_locked() -> None:
    scene = followed()
    scene.frames(30, {})
    # At 14 degrees the distance is 0.03: the log ratio of the clothes is 5, of 0.2 m in height -5.
    states = {scene.frame({7: (4, 1, 14.0)}, heights={7: 1.2}).state for _ in range(50)}
    assert states == {"searching", "lost"}
    scene.frames(30, {})
    assert scene.frames(5, {8: (4, 1, 14.0)}, heights={8: 1.03}).id == 8


def test_clothes_that_nearly_suffice_are_enough_with_the_same_height() -> None:
    scene = followed()
    scene.frames(30, {})
    # The distance is 0.073: log ratio (0.102 - 0.073) / 0.012 = 2.4, below log(0.95 / 0.05) = 2.9.
    assert scene.frames(5, {7: (4, 1, 22.0)}, heights={7: 1.08}).id is None
    scene.frames(30, {})
    assert scene.frames(5, {8: (4, 1, 22.0)}).id == 8  # 2.4 + log(0.09 / 0.04) = 3.2


def test_person_who_sits_down_stays_locked_and_is_known_by_the_new_height() -> None:
    scene = followed()
    states = {scene.frame({1: (3, 0, RED)}, heights={1: 0.6}).state for _ in range(100)}
    assert states == {"locked"}
    scene.frames(30, {})
    assert scene.frames(5, {7: (3, 0, RED)}, heights={7: 0.6}).id == 7


def test_height_is_forgotten_with_the_frame_of_the_tracks() -> None:
    scene = followed()
    scene.frames(30, {}, frame_id="odom")
    assert scene.frames(5, {7: (3, 0, RED)}, heights={7: 2.0}, frame_id="odom").id == 7


def test_alike_person_in_view_during_an_absence_is_not_locked_later() -> None:
    """Track 2 is another person by continuity, so its views count against its later tracks."""
    scene = followed()
    people = {1: (3.0, 0.0, RED), 2: (5.0, 2.0, 20.0)}
    scene.frames(2, people, with_embeddings=False)
    scene.frames(10, {2: people[2]})
    scene.frames(30, {})
    # At 20 degrees the distance is 0.06, and an unknown person is expected at 0.14.
    assert {scene.frame({7: (4.0, 1.0, 20.0)}).id for _ in range(50)} == {None}
    scene.frames(30, {})
    assert scene.frames(10, {8: (3.0, 0.0, RED)}).id == 8


def test_returning_person_is_locked_while_the_alike_one_stays_in_view() -> None:
    # The track of the other person was never interrupted.
    scene = followed(p2=(5, 2, RED))
    scene.frames(30, {2: (5, 2, RED)})
    assert scene.frames(10, {2: (5, 2, RED), 7: (3, 0, RED)}).id == 7


def test_tracks_that_exchange_their_people_do_not_move_the_lock() -> None:
    """After a meeting track 1 continues with the other person, and track 2 with the chosen one."""
    scene = followed(p2=(5, 2, BLUE))
    scene.frames(3, {1: (3, 0, RED), 2: (3.4, 0, BLUE)})
    after = [scene.frame({1: (3, 0, BLUE), 2: (5, 2, RED)}) for _ in range(20)]
    assert {target.id for target in after} <= {None, 2}
    assert after[-1].id == 2


def test_alike_people_are_ambiguous_after_a_meeting() -> None:
    scene = followed(p2=(5, 2, RED))
    scene.frames(3, {1: (3, 0, RED), 2: (3.4, 0, RED)})
    states = {scene.frame({1: (3, 0, RED), 2: (5, 2, RED)}).state for _ in range(50)}
    assert states <= {"searching", "lost"}


def test_person_is_locked_beside_a_person_who_touches_another_one() -> None:
    """Crops of people in contact with each other say nothing about a third track."""
    scene = followed(p2=(5, 2, 20.0), p3=(5.3, 2, 25.0))
    people = {1: (3.0, 0.0, RED), 2: (5.0, 2.0, 20.0), 3: (5.3, 2.0, 25.0)}
    assert {scene.frame(people).id for _ in range(50)} == {1}


def test_crops_that_repeat_each_other_do_not_add_up() -> None:
    """A person who is barely alike is not locked after any number of crops."""
    scene = followed()
    scene.frames(30, {})
    # At 28 degrees the distance is 0.12, and an unknown person is expected at 0.14.
    assert {scene.frame({7: (3.0, 0.0, 28.0)}).id for _ in range(200)} == {None}


def test_person_without_a_clear_view_is_not_found_by_elimination() -> None:
    scene = Scene()
    scene.frame({1: (3, 0, RED)}, with_embeddings=False)
    scene.choose(id=1)
    assert scene.frames(5, {1: (3, 0, RED)}, with_embeddings=False).state == "locked"
    scene.frames(30, {})
    assert {scene.frame({7: (3.0, 0.0, BLUE)}).id for _ in range(100)} == {None}


def test_person_at_the_side_of_the_image_is_learnt_and_not_locked_by_appearance() -> None:
    scene = Scene()
    scene.choose(id=1)
    assert scene.frames(10, {1: (3, 0, RED)}, cut=[1]).state == "locked"
    scene.frames(30, {})
    assert scene.frames(10, {7: (3, 0, RED)}, cut=[7]).id is None
    assert scene.frames(10, {7: (3, 0, RED)}).id == 7


def test_track_with_another_appearance_loses_the_lock() -> None:
    """An identity switch of the tracker without any sign but the appearance."""
    scene = followed(p2=(5, 2, BLUE))
    assert scene.frame({1: (3, 0, BLUE)}).state == "searching"
    assert scene.frames(20, {1: (3, 0, BLUE)}).state in ("searching", "lost")


def test_person_too_far_away_to_be_the_chosen_one_is_not_locked() -> None:
    # At 2.5 m/s a person walks 1.25 m in 0.5 s, not 30 m.
    scene = followed()
    scene.frames(4, {})
    states = {scene.frame({7: (33, 0, RED)}).state for _ in range(30)}
    assert states <= {"searching", "lost"}


def test_views_of_another_person_are_not_learnt() -> None:
    scene = followed(p2=(5, 2, BLUE))
    scene.frames(20, {1: (3, 0, BLUE), 2: (5, 2, BLUE)})
    scene.frames(30, {})
    assert scene.frames(30, {7: (4, 1, BLUE)}).state in ("searching", "lost")


def test_views_of_all_sides_are_learnt_while_the_lock_is_certain() -> None:
    scene = followed(p2=(5, 2, 200.0))
    for angle in range(0, 100, 5):  # the person turns round
        scene.frame({1: (3, 0, float(angle)), 2: (5, 2, 200.0)})
    scene.frames(30, {2: (5, 2, 200.0)})
    assert scene.frames(10, {2: (5, 2, 200.0), 7: (3, 0, 95.0)}).id == 7


def test_clock_reset_keeps_the_person_by_appearance() -> None:
    """A recording loops: the tracker starts again with other tracks, far from the last position."""
    scene = followed(p2=(5, 2, BLUE))
    scene.stamp_ns -= 1_100_000_000
    people = {8: (40.0, 0.0, RED), 9: (3.0, 0.0, BLUE)}
    assert scene.frame(people).state in ("searching", "lost")
    assert scene.frames(10, people).id == 8
    assert scene.node.status().counters["clock_resets"] == 1


def test_same_number_after_a_restart_of_the_tracker_is_not_believed() -> None:
    scene = followed(p2=(5, 2, BLUE))
    again = Scene(scene.node, scene.stamp_ns)  # tracks begin with age 1
    people = {1: (5.0, 2.0, BLUE), 2: (3.0, 0.0, RED)}
    assert {again.frame(people).id for _ in range(3)} <= {None, 2}
    assert again.frames(10, people).id == 2


def test_state_outlives_the_process() -> None:
    scene = followed(p2=(5, 2, BLUE))
    node = build(TargetConfig())
    node.restore(scene.node.save(), 0)
    again = Scene(node, scene.stamp_ns + 2_000_000_000)
    people = {11: (3.0, 0.0, BLUE), 12: (5.0, 2.0, RED)}
    assert again.frame(people).state in ("searching", "lost")
    assert again.frames(10, people).id == 12


def test_views_of_another_embedder_are_dropped() -> None:
    scene = followed()
    scene.node._chosen.memory.appearance.embedder = ("other", 2)
    scene.frame({})
    target = scene.frames(30, {7: (3, 0, RED)})
    assert target.state in ("searching", "lost")
    assert target.reason == "no clear view of the person is known"
