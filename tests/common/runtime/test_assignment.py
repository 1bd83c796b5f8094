"""Assignment of messages to replicas, worked out by hand."""

import itertools
from collections import Counter

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.runtime.assignment import (
    EXCLUDED_S,
    REPLICAS_MAX,
    SILENT_S,
    TRIED_MAX,
    Assignment,
    Membership,
    MessageHeader,
    PendingMessage,
    assigned_replica,
    read_header,
)
from common.runtime.node import Sharing
from people4d.codec import encode
from people4d.messages import Crops, Detections, Embeddings, RgbdFrame
from tests.contract.examples import BY_NAME

FRAMES = Sharing(RgbdFrame, Detections)
CROPS = Sharing(Crops, Embeddings)
KEY = "people4d/v1/robot/raw/front/rgbd"

replica_names = st.lists(st.text("abcd", min_size=1), min_size=2, max_size=8, unique=True)


def test_frame_is_assigned_to_none_if_there_is_no_replica() -> None:
    assert assigned_replica((), "front", 0) is None


@given(replica_names, st.integers(0, 2**53 - 1), st.text("xyz", min_size=1, max_size=5))
def test_replicas_take_turns(names: list[str], start: int, camera: str) -> None:
    assigned = [assigned_replica(names, camera, start + k) for k in range(3 * len(names))]
    assert Counter(assigned) == dict.fromkeys(names, 3)
    assert all(a != b for a, b in itertools.pairwise(assigned))


@pytest.mark.parametrize("cameras", [("front", "rear"), ("left", "right"), ("a", "b")])
def test_cameras_in_step_share_both_replicas(cameras: tuple[str, str]) -> None:
    names = ("detector-1", "detector-2")
    assigned = Counter(assigned_replica(names, camera, k) for camera in cameras for k in range(100))
    assert set(assigned.values()) == {100}


def membership(*names: str) -> Membership:
    """Return the membership at replica a at time 0."""
    made = Membership("a")
    for name in names:
        made.add_replica(name, 0.0)
    made.update_replicas(0.0)
    return made


def test_replicas_with_a_token_are_live_and_sorted() -> None:
    assert membership("b", "a").replicas == ("a", "b")
    assert membership("b").replicas == ("b",)  # this process has not announced itself yet
    assert membership().replicas == ()


def test_invented_replicas_are_bounded_and_heartbeats_without_a_token_forgotten() -> None:
    many = membership("a", *(f"x{number}" for number in range(300)))
    assert len(many.replicas) == 1 + TRIED_MAX
    assert "a" in many.replicas
    for number in range(1000):
        many.note_heartbeat(f"y{number}", stalled=False, now_s=0.0)
    assert len(many._heartbeats_s) == REPLICAS_MAX


def test_invented_replicas_leave_a_third_of_the_frames_and_are_excluded_in_turn() -> None:
    one = assignment("a", *(f"x{number}" for number in range(300)))
    ours = []
    for number in range(600):
        now_s = number / 15
        for name in range(300):
            one.note_heartbeat(f"x{name}", stalled=False, now_s=now_s)
        if one.is_ours(frame(number), now_s):
            ours.append(number)
        one.reassign(now_s)
    # One of three replicas in turns is real; all 15 are tried within 15 / 2 * 3 s and a frame each.
    assert max(b - a for a, b in itertools.pairwise(ours)) <= 1 + TRIED_MAX
    assert ours[-200:] == list(range(400, 600))


def test_replicas_that_answer_are_all_used() -> None:
    one = assignment("a", "b", "c", "d", "e", sharing=CROPS)
    for number in range(40):
        if not one.is_ours(frame(number), 0.1):
            one.answered(MessageHeader("front", number))
        one.reassign(0.1)
    assert one.replicas == ("a", "b", "c", "d", "e")


def test_replica_that_answers_nothing_is_excluded_for_a_while() -> None:
    two = membership("a", "b")
    two.note_answered("b")
    for second in range(7):
        two.note_heartbeat("b", stalled=False, now_s=second)
        two.note_assigned("b", second)
        two.update_replicas(second)
        # Three messages and more than 5 s since the first: at the seventh.
        assert two.replicas == (("a", "b") if second < 6 else ("a",))
    two.note_heartbeat("b", stalled=False, now_s=6 + EXCLUDED_S)
    two.update_replicas(6 + EXCLUDED_S)
    assert two.replicas == ("a", "b")


@pytest.mark.parametrize(
    ("seconds", "excluded"),
    [((0.0, 6.0), False), ((0.0, 1.0, 4.9), False), ((0.0, 1.0, 5.1), True)],
)
def test_third_unanswered_message_after_five_seconds_excludes(
    seconds: tuple[float, ...], excluded: bool
) -> None:
    two = membership("a", "b")
    two.note_answered("b")
    for now_s in seconds:
        two.note_heartbeat("b", stalled=False, now_s=now_s)
        two.note_assigned("b", now_s)
    two.update_replicas(seconds[-1])
    assert two.replicas == (("a",) if excluded else ("a", "b"))


def test_replica_that_answers_slowly_is_not_excluded() -> None:
    two = membership("a", "b")
    two.note_answered("b")
    for second in range(60):
        two.note_heartbeat("b", stalled=False, now_s=second)
        two.note_assigned("b", second)
        if second % 5 == 4:
            two.note_answered("b")
        two.update_replicas(second)
        assert two.replicas == ("a", "b")


def test_token_that_vanishes_removes_its_replica_at_once() -> None:
    two = membership("a", "b")
    two.remove_replica("b")
    assert two.update_replicas(0.001)
    assert two.replicas == ("a",)
    assert not two.update_replicas(0.002)


def test_replica_without_heartbeats_is_out_until_the_next() -> None:
    two = membership("a", "b")
    two.note_heartbeat("b", stalled=False, now_s=1.0)
    assert not two.update_replicas(1.0 + SILENT_S - 0.01)
    assert two.update_replicas(1.0 + SILENT_S)
    assert two.replicas == ("a",)
    two.note_heartbeat("b", stalled=False, now_s=5.0)
    assert two.update_replicas(5.0)
    assert len(two.replicas) == 2


def test_new_token_counts_as_a_heartbeat() -> None:
    two = membership("a")
    two.add_replica("b", 10.0)
    two.update_replicas(10.0 + SILENT_S - 0.01)
    assert two.replicas == ("a", "b")


def test_stalled_replica_is_out_until_it_goes_on() -> None:
    two = membership("a", "b")
    two.note_heartbeat("b", stalled=True, now_s=0.5)
    assert two.update_replicas(0.5)
    assert two.replicas == ("a",)
    two.note_heartbeat("b", stalled=False, now_s=1.0)
    assert two.update_replicas(1.0)


def test_own_replica_stays_live_without_heartbeats() -> None:
    one = membership("a")
    one.update_replicas(100.0)
    assert one.replicas == ("a",)


def test_heartbeat_without_a_token_adds_no_replica() -> None:
    one = membership("a")
    one.note_heartbeat("b", stalled=False, now_s=0.0)
    assert not one.update_replicas(0.0)


def test_time_in_which_this_process_was_stopped_does_not_count_as_silence() -> None:
    two = membership("a", "b")
    two.extend_deadlines(60.0)
    assert not two.update_replicas(60.0 + SILENT_S - 0.01)
    assert two.update_replicas(60.0 + SILENT_S)


def assignment(own_name: str, *others: str, sharing: Sharing = FRAMES) -> Assignment:
    made = Assignment(own_name, sharing)
    for name in (own_name, *others):
        made.add_replica(name, 0.0)
    return made


def frame(sequence: int, lockstep: bool = False) -> PendingMessage:
    return PendingMessage(KEY, b"", 0, MessageHeader("front", sequence, lockstep))


def numbers(messages: list[PendingMessage]) -> list[int]:
    return [message.header.sequence for message in messages]


def divide(
    assignments: list[Assignment], sequences: range, lockstep: bool = False
) -> list[list[int]]:
    return [[k for k in sequences if one.is_ours(frame(k, lockstep), 0.0)] for one in assignments]


@pytest.mark.parametrize("name", ["RgbdFrame", "Crops", "Detections", "Embeddings"])
def test_header_is_read_from_real_messages(name: str) -> None:
    message = BY_NAME[name]
    assert isinstance(message, RgbdFrame | Crops | Detections | Embeddings)
    header = read_header(encode(message))
    assert header is not None
    assert (header.camera, header.sequence) == (message.camera, message.sequence)
    assert header.lockstep == (isinstance(message, RgbdFrame) and message.lockstep)


@given(st.binary(max_size=200))
def test_bytes_that_are_no_message_have_no_header(junk: bytes) -> None:
    found = read_header(junk)
    assert found is None or isinstance(found.sequence, int)


def test_deeply_nested_bytes_have_no_header() -> None:
    assert read_header(b"\x81\xa5other" + b"\x91" * 100_000) is None


def test_every_frame_is_assigned_to_exactly_one_replica() -> None:
    names = ["a", "b", "c"]
    assignments = [assignment(me, *(n for n in names if n != me)) for me in names]
    done = divide(assignments, range(300))
    assert [len(part) for part in done] == [100, 100, 100]
    assert sorted(k for part in done for k in part) == list(range(300))


def test_single_replica_gets_every_frame() -> None:
    assert divide([assignment("a")], range(10)) == [list(range(10))]


def test_replica_that_joins_gets_pending_messages() -> None:
    one = Assignment("a", FRAMES)
    assert not one.is_ours(frame(0, lockstep=True), 0.0)
    assert numbers(one.add_replica("a", 0.0)) == [0]


def test_unanswered_frames_of_a_dead_replica_are_taken_over() -> None:
    one = assignment("a", "b")
    (mine,) = divide([one], range(6), lockstep=True)
    others = [k for k in range(6) if k not in mine]
    # b answers the first of its frames, then dies.
    one.answered(MessageHeader("front", others[0]))
    assert numbers(one.remove_replica("b", 1.0)) == others[1:]
    assert numbers(one.remove_replica("b", 1.0)) == []


def test_frames_of_a_silent_replica_are_taken_over_after_its_timeout() -> None:
    one = assignment("a", "b")
    divide([one], range(4), lockstep=True)
    one.note_heartbeat("b", stalled=False, now_s=3.0)
    assert one.reassign(3.0 + SILENT_S - 0.01) == []
    assert len(one.reassign(3.0 + SILENT_S)) == 2
    assert one.replicas == ("a",)


def test_of_frames_that_may_be_skipped_only_the_newest_is_taken_over() -> None:
    taken = []
    for frames in (6, 7):  # Two replicas take turns, so the last frame is ours in one case only
        one = assignment("a", "b")
        (mine,) = divide([one], range(frames))
        taken.append(numbers(one.remove_replica("b", 1.0)))
        # A frame older than our last frame is useless: the tracker has passed it.
        assert taken[-1] == ([] if mine[-1] == frames - 1 else [frames - 1])
    assert sorted(map(len, taken)) == [0, 1]


def test_replica_that_joins_leaves_earlier_frames_to_the_others() -> None:
    # The new replica has never received these frames.
    one = assignment("a")
    (mine,) = divide([one], range(4), lockstep=True)
    assert mine == [0, 1, 2, 3]
    assert one.add_replica("b", 1.0) == []


def test_pending_crops_are_limited_to_the_depth_of_their_queue() -> None:
    one = assignment("a", "b", sharing=CROPS)
    others = [k for k in range(100) if not one.is_ours(frame(k), 0.0)]
    assert numbers(one.remove_replica("b", 1.0)) == others[-8:]


def test_memberships_that_differ_briefly_lose_no_frame() -> None:
    # b dies after frame 2; a notices at once, c only after frame 5. Each later frame is handled by
    # a or c, some by both.
    names = ["a", "b", "c"]
    assignments = {me: assignment(me, *(n for n in names if n != me)) for me in "ac"}
    done: set[int] = set()

    def come(sequences: range) -> None:
        for me, one in assignments.items():
            mine = [k for k in sequences if one.is_ours(frame(k, lockstep=True), 0.0)]
            done.update(mine)
            for other in assignments:
                if other != me:
                    for k in mine:
                        assignments[other].answered(MessageHeader("front", k))

    come(range(3))
    done.update(numbers(assignments["a"].remove_replica("b", 1.0)))
    come(range(3, 6))
    done.update(numbers(assignments["c"].remove_replica("b", 1.1)))
    come(range(6, 12))
    assert done == set(range(12))


def test_header_ignores_other_fields() -> None:
    assert msgspec.msgpack.decode(
        msgspec.msgpack.encode({"camera": "front", "sequence": 3, "x": [1, {}]}), type=MessageHeader
    ) == MessageHeader("front", 3)
