"""The bridge in pace with frames and by its own clock."""

import itertools
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np
import pytest

from people4d.codec import decode, encode
from people4d.errors import SourceError
from people4d.messages import Detections, Message, Score, Tracks, Truth, TruthPerson
from services.gt_bridge.config import FixedTransform, GtBridgeConfig
from services.gt_bridge.node import GtBridgeNode
from tests import builders
from tests.contract.odd import in_order, out_of_order
from tests.gt_bridge.scene import INFO, POSE, person, track, tracks
from tests.gt_bridge.scene import truth as captured

S = 10**9


def truth(*stamps_s: float) -> list[Truth]:
    """One person at x = stamp."""
    return [
        builders.truth(
            TruthPerson(id="a", position_m=np.array([s, 0.0, 1.0])),
            stamp_ns=round(s * S),
            sequence=7,
        )
        for s in stamps_s
    ]


def frame(stamp_s: float) -> Detections:
    return builders.detections(stamp_ns=round(stamp_s * S))


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
    assert node.status().counters["skipped"] == 2


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
    # Round length 2 s: the truth at 1.0, 2.0 repeats at 3.0, 4.0 and at 5.0, 6.0.
    node = GtBridgeNode(truth(1.0, 2.0), GtBridgeConfig(loop_s=2.0))
    out = [node.handle(frame(s), 0) for s in (1.0, 2.0, 3.0, 4.0, 5.0)]
    assert [stamps_s(m) for m in out] == [[1.0], [2.0], [3.0], [4.0], [5.0]]
    last = out[-1][0]
    assert isinstance(last, Truth)
    assert last.people[0].position_m[0] == 1.0  # the person is where the first round began


def test_a_round_shorter_by_a_rounded_nanosecond_begins_with_its_first_frame() -> None:
    # 3 frames at 15 Hz: the camera adds 66 666 666 ns a frame and not a fifteenth of a second.
    node = GtBridgeNode(truth(1.0, 1.1), GtBridgeConfig(loop_s=0.2))
    node.handle(frame(1.0), 0)
    node.handle(frame(1.2 - 1e-9), 0)
    assert node.status().counters["restarts"] == 1


def test_offset_moves_the_stamps() -> None:
    node = GtBridgeNode(truth(0.0), GtBridgeConfig(offset_s=1700.0))
    assert stamps_s(node.handle(frame(1700.0), 0)) == [1700.0]


def test_no_truth_is_a_calm_state() -> None:
    node = GtBridgeNode(())
    assert node.handle(frame(1.0), 0) == []
    assert node.tick(0) == []
    assert (node.status().state, node.status().reason) == ("ready", "there is no truth")


def test_a_file_that_fails_half_through_degrades() -> None:
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


def walking() -> list[Truth]:
    """A person at x = 2 + t, captured at 10 Hz for 3 s."""
    return [captured(k * 100, person("a", 2.0 + k / 10, 0.0, vx=1.0)) for k in range(31)]


def scores(messages: Sequence[Message]) -> list[Score]:
    return [m for m in messages if isinstance(m, Score)]


def test_each_frame_is_scored_as_soon_as_its_tracks_arrive() -> None:
    node = GtBridgeNode(walking())
    for message in (INFO, POSE):
        assert node.handle(message, 0) == []
    for k in range(1, 4):
        stamp_ms = k * 250  # between two samples; the later one is not yet sent
        sent = node.handle(frame(stamp_ms / 1000), 0)
        assert max(stamps_s(sent)) <= stamp_ms / 1000
        (got,) = scores(node.handle(tracks(stamp_ms, track(1, 2.0 + k / 4 + 0.3, 0.4, vx=1.0)), 0))
        assert got.people[0].position_error_m == pytest.approx([0.3, 0.4])
        assert got.people[0].view == "inside"
        assert got.total.frames == k
    assert got.total.position_rmse_m == pytest.approx(0.5)
    assert got.total.velocity_rmse_mps == pytest.approx(0.0)


def test_each_round_of_a_looping_camera_is_scored_anew() -> None:
    node = GtBridgeNode(walking(), GtBridgeConfig(loop_s=3.0))
    total = None
    for stamp_ms in range(500, 6001, 500):
        node.handle(frame(stamp_ms / 1000), 0)
        x = 2.0 + (stamp_ms % 3000) / 1000
        number = 1 + stamp_ms // 3000  # the tracker reports another person
        for got in scores(node.handle(tracks(stamp_ms, track(number, x, 0.0)), 0)):
            total = got.total
            assert total.id_switches == 0
    assert total is not None
    assert total.frames < 8  # of the last round


def test_truth_in_its_own_frame_is_transformed_as_configured() -> None:
    there = [captured(0, person("a", 1.0, 0.0, vx=1.0), frame_id="mocap"), captured(100)]
    config = GtBridgeConfig(
        transforms=(FixedTransform(parent="map", child="mocap", xyz_m=(1.0, 2.0, 0.0)),)
    )
    (got,) = GtBridgeNode(there, config).handle(frame(0.05), 0)
    assert isinstance(got, Truth)
    assert (got.frame_id, got.people[0].position_m.tolist()) == ("map", [2.0, 2.0, 1.0])


def test_truth_without_a_transform_stays_in_its_frame_and_degrades() -> None:
    node = GtBridgeNode([captured(0, frame_id="mocap")])
    (got,) = node.handle(frame(0.05), 0)
    assert isinstance(got, Truth)
    assert got.frame_id == "mocap"
    assert node.status().state == "degraded"
    assert "no transform map <- mocap" in node.status().reason


@pytest.mark.slow
def test_odd_messages_raise_nothing_while_scoring() -> None:
    people = [person("a", 1.0, 2.0, vx=0.1, yaw_deg=20), person("far", 9e6, 0.0)]
    node = GtBridgeNode(
        [captured(k * 50, *people) for k in range(-40, 41)],
        GtBridgeConfig(align_clock_s=0.5, align_space="3d", apply_alignment=True),
    )
    scored = 0
    for message in itertools.chain(in_order(), out_of_order(), in_order()):
        if isinstance(message, node.inputs):
            for answer in node.handle(decode(encode(message)), 0):
                assert decode(encode(answer))
            if isinstance(message, Tracks):  # the same at a time with truth
                node.handle(frame(1.0), 0)
                timely = msgspec.structs.replace(message, stamp_ns=S, frame_id="map")
                for answer in node.handle(timely, 0):
                    scored += isinstance(decode(encode(answer)), Score)
    assert scored > 20
    assert node.status().state != "finished"


def test_people_beyond_reason_are_left_out() -> None:
    node = GtBridgeNode([captured(0, person("far", 9e6, 9e6), person("a", 1.0, 0.0))])
    (got,) = node.handle(frame(0.05), 0)
    assert isinstance(got, Truth)
    assert [p.id for p in got.people] == ["a"]
    assert node.status().counters["too_far"] == 1


def test_200_people() -> None:
    crowd = [person(str(k), 1.0 + k % 20, k // 20 - 5.0, vx=0.0) for k in range(200)]
    node = GtBridgeNode([captured(k * 100, *crowd) for k in range(20)])
    found = [track(k + 1, 1.0 + k % 20, k // 20 - 5.0) for k in range(200)]
    for stamp_ms in range(100, 1000, 100):
        node.handle(frame(stamp_ms / 1000), 0)
        (got,) = scores(node.handle(tracks(stamp_ms, *found), 0))
    assert (got.total.matched, got.total.id_switches, got.id_consistency) == (9 * 200, 0, 1.0)
