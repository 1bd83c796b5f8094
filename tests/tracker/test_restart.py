"""The tracker node goes on where the process before it was killed."""

from collections.abc import Sequence

import numpy as np
import pytest

from people4d.errors import DecodeError
from people4d.messages import Message, StaticTransform, Tracks
from services.tracker.node import TrackerNode
from tests.tracker.test_node import TRANSFORM, feed, looks, node, person, seen, tracks

TWO = ([1.0, 0.0], [0.0, 1.0])


def frames(first: int, last: int, shift_m: float = 0.0) -> list[Message]:
    """Two people, frames first to last - 1 of ten a second."""
    messages: list[Message] = []
    for k in range(first, last):
        frame = seen(k, [person(-0.8 + shift_m), person(0.8 + shift_m)])
        messages += [frame, looks(frame, TWO)]
    return messages


def told(target: TrackerNode, messages: Sequence[Message]) -> list[Tracks]:
    """Return all answers; a frame that others may yet precede does not wait for them."""
    return [*feed(target, messages), *tracks(target.flush(0))]


def restarted(before: TrackerNode) -> TrackerNode:
    after = node()
    after.restore(before.save(), before.next_number())
    return after


def test_people_who_did_not_move_far_keep_their_identities_over_two_seconds() -> None:
    before = node()
    told(before, [TRANSFORM, *frames(0, 10)])
    after = restarted(before)
    shown = told(after, frames(30, 34, shift_m=0.3))
    for message in shown:
        assert [(p.id, p.state) for p in message.tracks] == [(1, "confirmed"), (2, "confirmed")]
    left, right = (p.position_m[1] for p in shown[-1].tracks)
    assert left > right  # 1 is the one at x = -0.8 in the image, to the left


def test_people_who_stand_are_known_after_fifteen_seconds_but_others_are_not() -> None:
    before = node()
    told(before, [TRANSFORM, *frames(0, 10)])
    # 15 s later, where a track that nobody saw for 5 s had ended.
    shown = told(restarted(before), frames(160, 164, shift_m=0.3))
    assert [(p.id, p.state) for p in shown[-1].tracks] == [(1, "confirmed"), (2, "confirmed")]
    # 3 m away nobody who stands can be; after 31 s nobody is expected any more.
    for away in (frames(160, 164, shift_m=4.0), frames(330, 334)):
        people = told(restarted(before), away)[-1].tracks
        assert [p.id for p in people if p.state == "confirmed"] == [3, 4]


def test_people_who_stand_are_known_when_no_frame_came_for_fifteen_seconds() -> None:
    target = node()
    told(target, [TRANSFORM, *frames(0, 10)])
    shown = told(target, frames(160, 164, shift_m=0.3))
    assert [(p.id, p.state) for p in shown[-1].tracks] == [(1, "confirmed"), (2, "confirmed")]
    strict = node(absence_max_s=5.0)
    told(strict, [TRANSFORM, *frames(0, 10)])
    shown = told(strict, frames(160, 164, shift_m=0.3))
    assert [p.id for p in shown[-1].tracks] == [3, 4]


def test_people_who_walk_are_where_they_were_going_after_two_seconds() -> None:
    # Both walk to the right, 0.1 m from frame to frame; 2 s after frame 9 they are 2 m on.
    before = node()
    walking = [m for k in range(10) for m in frames(k, k + 1, shift_m=-1.5 + 0.1 * k)]
    told(before, [TRANSFORM, *walking])
    after = restarted(before)
    shown = [t for k in range(29, 33) for t in told(after, frames(k, k + 1, -1.5 + 0.1 * k))]
    assert [p.id for p in shown[-1].tracks if p.state == "confirmed"] == [1, 2]


def test_the_camera_s_place_is_known_before_it_is_told_again() -> None:
    before = node()
    told(before, [TRANSFORM, *frames(0, 10)])
    after = restarted(before)
    first = told(after, frames(10, 11))
    assert after.status().state == "ready"
    # Told again as it was, people go on; told otherwise, they begin anew with new numbers.
    (same,) = told(after, [TRANSFORM, *frames(11, 12)])
    assert [p.id for p in first[-1].tracks] == [p.id for p in same.tracks] == [1, 2]
    moved = np.array(TRANSFORM.matrix)
    moved[0, 3] += 1.0
    other = StaticTransform(
        stamp_ns=0, sequence=1, parent="map", child="camera_optical", matrix=moved
    )
    shown = told(after, [other, *frames(12, 16)])
    assert [p.id for p in shown[-1].tracks] == [3, 4]
    assert after.status().counters["transform_changes"] == 1


def test_a_frame_from_before_the_restart_is_stale() -> None:
    before = node()
    told(before, [TRANSFORM, *frames(0, 10)])
    after = restarted(before)
    assert told(after, frames(5, 6)) == []
    assert after.status().counters["stale"] == 1
    assert len(told(after, frames(10, 11))) == 1


def test_a_recording_that_began_again_meanwhile_gives_new_identities() -> None:
    before = node()
    told(before, [TRANSFORM, *frames(20, 40)])
    after = restarted(before)
    shown = told(after, frames(0, 5))
    assert [p.id for p in shown[-1].tracks] == [3, 4]
    assert after.status().counters["clock_resets"] == 1


def test_identities_go_on_though_everything_else_is_lost() -> None:
    before = node()
    told(before, [TRANSFORM, *frames(0, 10)])
    after = node()
    with pytest.raises(DecodeError):
        after.restore(before.save()[:-5], before.next_number())
    shown = told(after, [TRANSFORM, *frames(10, 15)])
    assert [p.id for p in shown[-1].tracks] == [3, 4]


def test_a_restart_before_the_first_frame_keeps_what_was_restored() -> None:
    before = node()
    told(before, [TRANSFORM, *frames(0, 10)])
    after = restarted(restarted(before))
    assert [p.id for p in told(after, frames(10, 11))[-1].tracks] == [1, 2]


def test_a_frame_that_waits_for_embeddings_at_the_end_is_answered_still() -> None:
    target = node()
    assert feed(target, [TRANSFORM, seen(0), seen(1)]) == []
    assert [m.sequence for m in target.flush(0)] == [0, 1]
    assert target.flush(0) == []


def test_nothing_is_saved_before_the_first_frame() -> None:
    empty = node()
    assert empty.save() == b""
    assert empty.next_number() == 1
