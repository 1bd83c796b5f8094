"""A restarted tracker node continues the tracks of the killed process."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from people4d.errors import DecodeError
from people4d.messages import Message, Tracks
from services.tracker.node import TrackerNode
from tests import builders
from tests.tracker.test_node import TRANSFORM, detected, embeddings_of, feed, node, person, tracks

TWO = ([1.0, 0.0], [0.0, 1.0])


def frames(first: int, last: int, shift_m: float = 0.0) -> list[Message]:
    """Two people, frames first to last - 1 of ten a second."""
    messages: list[Message] = []
    for k in range(first, last):
        frame = detected(k, [person(-0.8 + shift_m), person(0.8 + shift_m)])
        messages += [frame, embeddings_of(frame, TWO)]
    return messages


def results(target: TrackerNode, messages: Sequence[Message]) -> list[Tracks]:
    """Return all answers, without the wait for earlier frames."""
    return [*feed(target, messages), *tracks(target.flush(0))]


def restarted(before: TrackerNode) -> TrackerNode:
    after = node()
    after.restore(before.save(), before.next_number())
    return after


def test_people_who_did_not_move_far_keep_their_identities_over_two_seconds() -> None:
    before = node()
    results(before, [TRANSFORM, *frames(0, 10)])
    after = restarted(before)
    shown = results(after, frames(30, 34, shift_m=0.3))
    for message in shown:
        assert [(p.id, p.state) for p in message.tracks] == [(1, "confirmed"), (2, "confirmed")]
    left, right = (p.position_m[1] for p in shown[-1].tracks)
    assert left > right  # person 1 is at x = -0.8 in the image, to the left


def test_standing_people_keep_identities_over_fifteen_seconds() -> None:
    before = node()
    results(before, [TRANSFORM, *frames(0, 10)])
    # 15 s later; a track without a match for 5 s would have ended.
    shown = results(restarted(before), frames(160, 164, shift_m=0.3))
    assert [(p.id, p.state) for p in shown[-1].tracks] == [(1, "confirmed"), (2, "confirmed")]
    # No standing person is 3 m away, and after 31 s no track is left.
    for away in (frames(160, 164, shift_m=4.0), frames(330, 334)):
        people = results(restarted(before), away)[-1].tracks
        assert [p.id for p in people if p.state == "confirmed"] == [3, 4]


def test_standing_people_keep_identities_without_frames_for_fifteen_seconds() -> None:
    target = node()
    results(target, [TRANSFORM, *frames(0, 10)])
    shown = results(target, frames(160, 164, shift_m=0.3))
    assert [(p.id, p.state) for p in shown[-1].tracks] == [(1, "confirmed"), (2, "confirmed")]


def test_people_who_walk_are_where_they_were_going_after_two_seconds() -> None:
    # Both people walk to the right by 0.1 m a frame; 2 s after frame 9 they are 2 m farther.
    before = node()
    walking = [m for k in range(10) for m in frames(k, k + 1, shift_m=-1.5 + 0.1 * k)]
    results(before, [TRANSFORM, *walking])
    after = restarted(before)
    shown = [t for k in range(29, 33) for t in results(after, frames(k, k + 1, -1.5 + 0.1 * k))]
    assert [p.id for p in shown[-1].tracks if p.state == "confirmed"] == [1, 2]


def test_camera_pose_is_restored_until_transforms_come() -> None:
    before = node()
    results(before, [TRANSFORM, *frames(0, 10)])
    after = restarted(before)
    first = results(after, frames(10, 11))
    assert after.status().state == "ready"
    # The same transform again changes nothing; a different transform begins new identities.
    (same,) = results(after, [TRANSFORM, *frames(11, 12)])
    assert [p.id for p in first[-1].tracks] == [p.id for p in same.tracks] == [1, 2]
    moved = np.array(TRANSFORM.matrix)
    moved[0, 3] += 1.0
    other = builders.static_transform(moved, sequence=1, child="camera_optical")
    shown = results(after, [other, *frames(12, 16)])
    assert [p.id for p in shown[-1].tracks] == [3, 4]
    assert after.status().counters["transform_changes"] == 1


def test_a_frame_from_before_the_restart_is_stale() -> None:
    before = node()
    results(before, [TRANSFORM, *frames(0, 10)])
    after = restarted(before)
    assert results(after, frames(5, 6)) == []
    assert after.status().counters["stale"] == 1
    assert len(results(after, frames(10, 11))) == 1


def test_a_recording_that_began_again_meanwhile_gives_new_identities() -> None:
    before = node()
    results(before, [TRANSFORM, *frames(20, 40)])
    after = restarted(before)
    shown = results(after, frames(0, 5))
    assert [p.id for p in shown[-1].tracks] == [3, 4]
    assert after.status().counters["clock_resets"] == 1


def test_identities_continue_without_a_checkpoint() -> None:
    before = node()
    results(before, [TRANSFORM, *frames(0, 10)])
    after = node()
    with pytest.raises(DecodeError):
        after.restore(before.save()[:-5], before.next_number())
    shown = results(after, [TRANSFORM, *frames(10, 15)])
    assert [p.id for p in shown[-1].tracks] == [3, 4]


def test_a_restart_before_the_first_frame_keeps_what_was_restored() -> None:
    before = node()
    results(before, [TRANSFORM, *frames(0, 10)])
    after = restarted(restarted(before))
    assert [p.id for p in results(after, frames(10, 11))[-1].tracks] == [1, 2]


def test_a_frame_that_waits_for_embeddings_at_the_end_is_answered_still() -> None:
    target = node()
    assert feed(target, [TRANSFORM, detected(0), detected(1)]) == []
    assert [m.sequence for m in target.flush(0)] == [0, 1]
    assert target.flush(0) == []


def test_nothing_is_saved_before_the_first_frame() -> None:
    empty = node()
    assert empty.save() == b""
    assert empty.next_number() == 1


@pytest.mark.parametrize("fields", [{"tracker": "sort3d"}, {"yaw": "none"}, {"frame_id": "odom"}])
def test_checkpoint_of_another_method_restores_numbers_only(fields: dict[str, Any]) -> None:
    before = node()
    results(before, [TRANSFORM, *frames(0, 10)])
    after = node(**fields)
    with pytest.raises(DecodeError, match="checkpoint: expected"):
        after.restore(before.save(), before.next_number())
    assert after.next_number() == 3
