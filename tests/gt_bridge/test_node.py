"""The bridge in pace with frames and by its own clock."""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
import pytest

from common.errors import SourceError
from common.messages import Detections, Message, Truth, TruthPerson
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.node import GtBridgeNode

S = 10**9


def truth(*stamps_s: float) -> list[Truth]:
    """One person who is at x = stamp."""
    return [
        Truth(
            stamp_ns=round(s * S),
            sequence=7,
            frame_id="map",
            people=(TruthPerson(id="a", position_m=np.array([s, 0.0, 1.0])),),
        )
        for s in stamps_s
    ]


def frame(stamp_s: float) -> Detections:
    return Detections(
        stamp_ns=round(stamp_s * S),
        sequence=0,
        camera="front",
        frame_id="front_optical_frame",
        model="none",
        width=640,
        height=480,
    )


def stamps_s(messages: Sequence[Message]) -> list[float]:
    return [m.stamp_ns / S for m in messages]


def test_frames_pull_the_truth_up_to_their_stamp() -> None:
    node = GtBridgeNode(truth(1.0, 1.1, 1.2, 1.3))
    assert stamps_s(node.handle(frame(0.9), 0)) == []
    assert stamps_s(node.handle(frame(1.1), 0)) == [1.0, 1.1]  # a stamp that is equal is due
    assert stamps_s(node.handle(frame(1.1), 0)) == []  # a second camera, the same moment
    assert stamps_s(node.handle(frame(9.0), 0)) == [1.2, 1.3]
    assert stamps_s(node.tick(10 * S)) == []
    assert node.status().state == "ready"


def test_sequence_counts_what_was_sent() -> None:
    node = GtBridgeNode(truth(1.0, 1.1))
    assert [m.sequence for m in node.handle(frame(2.0), 0)] == [0, 1]


def test_a_late_start_passes_over_old_truth() -> None:
    node = GtBridgeNode(truth(1.0, 2.0, 9.5, 10.0))
    assert stamps_s(node.handle(frame(10.0), 0)) == [9.5, 10.0]  # 1 s before the first frame
    assert node.status().counters["passed_over"] == 2


def test_playback_that_begins_again_begins_the_truth_again() -> None:
    node = GtBridgeNode(truth(1.0, 3.0, 5.0))
    node.handle(frame(1.0), 0)
    assert stamps_s(node.handle(frame(5.0), 0)) == [3.0, 5.0]
    assert stamps_s(node.handle(frame(1.0), 0)) == [1.0]
    assert node.status().counters["restarts"] == 1


def test_a_frame_slightly_out_of_order_changes_nothing() -> None:
    node = GtBridgeNode(truth(1.0, 3.0))
    node.handle(frame(1.1), 0)
    assert node.handle(frame(1.0), 0) == []
    assert stamps_s(node.handle(frame(3.0), 0)) == [3.0]


def test_a_loop_with_rising_stamps_is_followed() -> None:
    # Round length 2 s: the truth at 1.0, 2.0 comes again at 3.0, 4.0 and at 5.0, 6.0.
    node = GtBridgeNode(truth(1.0, 2.0), GtBridgeConfig(loop_s=2.0))
    out = [node.handle(frame(s), 0) for s in (1.0, 2.0, 3.0, 4.0, 5.0)]
    assert [stamps_s(m) for m in out] == [[1.0], [2.0], [3.0], [4.0], [5.0]]
    last = out[-1][0]
    assert isinstance(last, Truth)
    assert last.people[0].position_m[0] == 1.0  # the person is where the first round began


def test_offset_moves_the_stamps() -> None:
    node = GtBridgeNode(truth(0.0), GtBridgeConfig(offset_s=1700.0))
    assert stamps_s(node.handle(frame(1700.0), 0)) == [1700.0]


def test_recorded_pace_follows_its_clock_and_finishes() -> None:
    node = GtBridgeNode(truth(100.0, 100.5, 101.0), GtBridgeConfig(pace="recorded"))
    now = 5 * S
    assert stamps_s(node.tick(now)) == [100.0]
    assert node.wake_ns() == now + S // 2
    assert stamps_s(node.tick(now + S // 2 - 1)) == []
    assert node.handle(frame(200.0), now) == []  # frames do not pull
    assert node.status().state == "ready"
    assert stamps_s(node.tick(now + S)) == [100.5, 101.0]
    assert node.wake_ns() is None
    assert node.status().state == "finished"


def test_no_truth_is_a_calm_state() -> None:
    node = GtBridgeNode(())
    assert node.handle(frame(1.0), 0) == []
    assert node.tick(0) == []
    assert (node.status().state, node.status().reason) == ("ready", "there is no truth")


def test_a_file_that_fails_half_way_degrades() -> None:
    class Torn:
        def __iter__(self) -> Iterator[Truth]:
            yield from truth(1.0)
            raise SourceError("the bag is torn", "Record it again.")

    node = GtBridgeNode(Torn())
    assert stamps_s(node.handle(frame(2.0), 0)) == [1.0]
    assert node.status().state == "degraded"
    assert "the bag is torn" in node.status().reason


@pytest.mark.parametrize("order", list(itertools.permutations((1.0, 1.2, 1.4)))[:3])
def test_all_truth_goes_out_once_whatever_the_order_of_close_frames(
    order: tuple[float, ...],
) -> None:
    node = GtBridgeNode(truth(1.0, 1.1, 1.2, 1.3, 1.4))
    sent = [s for stamp in order for s in stamps_s(node.handle(frame(stamp), 0))]
    assert sent == [1.0, 1.1, 1.2, 1.3, 1.4]
