"""What is ours, what is others', and what is taken over from them."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.runtime.node import Sharing
from common.runtime.sharing import Head, Share, Spare, head_of
from common.runtime.team import SILENT_S, Team
from people4d.codec import encode
from people4d.messages import Crops, Detections, Embeddings, Message, RgbdFrame
from tests.contract.examples import BY_NAME

FRAMES = Sharing(RgbdFrame, Detections)
CROPS = Sharing(Crops, Embeddings)
KEY = "people4d/v1/robot/raw/front/rgbd"


def share(me: str, *others: str, sharing: Sharing = FRAMES) -> Share:
    made = Share(Team(me), me, sharing)
    for name in (me, *others):
        made.came(name, 1, 0.0)
    return made


def frame(sequence: int, lockstep: bool = False) -> Spare:
    return Spare(KEY, b"", 0, Head("front", sequence, lockstep))


def numbers(spares: list[Spare]) -> list[int]:
    return [spare.head.sequence for spare in spares]


def divide(shares: list[Share], sequences: range, lockstep: bool = False) -> list[list[int]]:
    return [[k for k in sequences if one.is_ours(frame(k, lockstep))] for one in shares]


@pytest.mark.parametrize("kind", [RgbdFrame, Crops, Detections, Embeddings])
def test_the_head_is_read_from_real_messages(kind: type[Message]) -> None:
    message = BY_NAME[kind.__name__]
    head = head_of(encode(message))
    assert head == Head(
        getattr(message, "camera", ""), message.sequence, getattr(message, "lockstep", False)
    )


@given(st.binary(max_size=200))
def test_bytes_that_are_no_message_have_no_head(junk: bytes) -> None:
    found = head_of(junk)
    assert found is None or isinstance(found.sequence, int)


def test_a_nested_bomb_has_no_head() -> None:
    assert head_of(b"\x81\xa5other" + b"\x91" * 100_000) is None


def test_every_frame_is_done_by_exactly_one() -> None:
    names = ["a", "b", "c"]
    shares = [share(me, *(n for n in names if n != me)) for me in names]
    done = divide(shares, range(300))
    assert [len(part) for part in done] == [100, 100, 100]
    assert sorted(k for part in done for k in part) == list(range(300))


def test_alone_everything_is_ours() -> None:
    assert divide([share("a")], range(10)) == [list(range(10))]


def test_before_joining_nothing_is_ours_and_then_what_waits() -> None:
    one = Share(Team("a"), "a", FRAMES)
    assert not one.is_ours(frame(0, lockstep=True))
    assert numbers(one.came("a", 1, 0.0)) == [0]


def test_frames_of_a_dead_replica_are_taken_over() -> None:
    one = share("a", "b")
    (mine,) = divide([one], range(6), lockstep=True)
    others = [k for k in range(6) if k not in mine]
    # b answers the first of its frames, then dies.
    one.answered(Head("front", others[0]))
    assert numbers(one.went("b", 1, 1.0)) == others[1:]
    assert numbers(one.went("b", 1, 1.0)) == []


def test_frames_of_a_hung_replica_are_taken_over_when_it_was_silent_too_long() -> None:
    one = share("a", "b")
    divide([one], range(4), lockstep=True)
    one.heard("b", True, 3.0)
    assert one.redivide(3.0 + SILENT_S - 0.01) == []
    assert len(one.redivide(3.0 + SILENT_S)) == 2
    assert one.members == ("a",)


def test_of_frames_that_may_be_skipped_only_the_newest_is_taken_over() -> None:
    taken = []
    for frames in (6, 7):  # of two in turns, the last frame is once ours, once the other's
        one = share("a", "b")
        (mine,) = divide([one], range(frames))
        taken.append(numbers(one.went("b", 1, 1.0)))
        # What is older than our own last is not worth it: the tracker has gone past it.
        assert taken[-1] == ([] if mine[-1] == frames - 1 else [frames - 1])
    assert sorted(map(len, taken)) == [0, 1]


def test_who_joins_gets_nothing_that_came_before() -> None:
    # The newcomer has never received it.
    one = share("a")
    (mine,) = divide([one], range(4), lockstep=True)
    assert mine == [0, 1, 2, 3]
    assert one.came("b", 1, 1.0) == []


def test_others_crops_are_kept_up_to_the_depth_of_their_queue() -> None:
    one = share("a", "b", sharing=CROPS)
    others = [k for k in range(100) if not one.is_ours(frame(k))]
    assert numbers(one.went("b", 1, 1.0)) == others[-8:]


def test_views_that_differ_for_a_moment_leave_nothing() -> None:
    # b dies after frame 2; a sees it at once, c only after frame 5. Whatever the order of turns,
    # each frame from then on is done by a or c, some perhaps by both.
    names = ["a", "b", "c"]
    shares = {me: share(me, *(n for n in names if n != me)) for me in "ac"}
    done: set[int] = set()

    def come(sequences: range) -> None:
        for me, one in shares.items():
            mine = [k for k in sequences if one.is_ours(frame(k, lockstep=True))]
            done.update(mine)
            for other in shares:
                if other != me:
                    for k in mine:
                        shares[other].answered(Head("front", k))

    come(range(3))
    done.update(numbers(shares["a"].went("b", 1, 1.0)))
    come(range(3, 6))
    done.update(numbers(shares["c"].went("b", 1, 1.1)))
    come(range(6, 12))
    assert done == set(range(12))


def test_heads_are_plain_records() -> None:
    assert msgspec.msgpack.decode(
        msgspec.msgpack.encode({"camera": "front", "sequence": 3, "x": [1, {}]}), type=Head
    ) == Head("front", 3)
