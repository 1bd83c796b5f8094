"""Messages that wait for a busy node."""

import sys
import threading
from collections.abc import Callable

import msgspec
import pytest

from common.runtime.assignment import Assignment
from common.runtime.inbox import Inbox
from common.runtime.node import Sharing
from people4d.codec import encode
from people4d.errors import DecodeError
from people4d.messages import Detections, Message, RgbdFrame, Truth
from people4d.queue import WAITING_MAX, Arrival
from people4d.topics import BY_NAME, ForeignTopic, Topic
from tests import builders
from tests.contract.examples import BY_NAME as EXAMPLES

FRAMES, DETECTIONS, ODOMETRY = BY_NAME["frames"], BY_NAME["detections"], BY_NAME["odometry"]
WAIT_S = 10.0


def put(inbox: Inbox, topic: Topic, sequence: int, key: str = "k", lockstep: bool = False) -> None:
    message = msgspec.structs.replace(EXAMPLES[topic.message.__name__], sequence=sequence)
    if topic is FRAMES:
        message = msgspec.structs.replace(message, lockstep=lockstep)
    inbox.add_payload(topic, key, encode(message))


def taken(inbox: Inbox) -> list[int]:
    """Empty the inbox and return the sequence numbers in order."""
    sequences = []
    while arrival := inbox.get(0.0):
        sequences.append(arrival.message.sequence)
    return sequences


def test_newest_live_frame_replaces_others_which_are_counted() -> None:
    inbox = Inbox()
    for sequence in (1, 2, 3):
        put(inbox, FRAMES, sequence)
    assert taken(inbox) == [3]
    assert inbox.counters == {"received_frames": 3, "dropped_frames": 2}


def test_newest_frame_of_each_camera_waits() -> None:
    inbox = Inbox()
    for key in ("left", "right"):
        put(inbox, FRAMES, 1, key)
    assert taken(inbox) == [1, 1]
    assert inbox.counters["dropped_frames"] == 0


def test_lockstep_frames_are_not_dropped() -> None:
    # At most two frames are unanswered, and the queue has room for both.
    inbox = Inbox()
    for sequence in (1, 2):
        put(inbox, FRAMES, sequence, lockstep=True)
    assert taken(inbox) == [1, 2]
    assert inbox.counters == {"received_frames": 2}


def test_queued_messages_wait_in_order_up_to_the_depth() -> None:
    inbox = Inbox()
    for sequence in range(DETECTIONS.depth + 3):
        put(inbox, DETECTIONS, sequence)
    assert taken(inbox) == list(range(3, DETECTIONS.depth + 3))
    assert inbox.counters["dropped_detections"] == 3


def test_the_oldest_comes_first_across_keys() -> None:
    inbox = Inbox()
    put(inbox, DETECTIONS, 1, "left")
    put(inbox, ODOMETRY, 2, "odometry")
    put(inbox, DETECTIONS, 3, "right")
    put(inbox, DETECTIONS, 4, "left")
    assert taken(inbox) == [1, 2, 3, 4]


def test_the_oldest_comes_first_where_newer_ones_replaced_others() -> None:
    inbox = Inbox()
    put(inbox, DETECTIONS, 1, "front")
    for sequence in range(500):
        put(inbox, FRAMES, sequence, "left")
    put(inbox, DETECTIONS, 501, "back")
    put(inbox, FRAMES, 502, "left")
    assert len(inbox._order) < 200
    assert taken(inbox) == [1, 501, 502]


def test_messages_of_a_key_stay_in_order_while_the_wall_clock_is_set_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    inbox, now_ns = Inbox(), 10**18
    monkeypatch.setattr("time.time_ns", lambda: now_ns)
    for sequence in range(3):
        put(inbox, DETECTIONS, sequence, "left")
        now_ns -= 10**9
    put(inbox, DETECTIONS, 3, "right")
    assert taken(inbox) == [3, 0, 1, 2]


def calls_of(work: Callable[[], object]) -> int:
    """Count function calls, a measure of cost independent of the machine's load."""
    count = 0

    def note(*_: object) -> None:
        nonlocal count
        count += 1

    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
    return count


def test_cost_of_a_message_does_not_grow_with_the_keys_that_wait() -> None:
    few, many = Inbox(), Inbox()
    for inbox, keys in ((few, 2), (many, WAITING_MAX)):
        for sequence in range(keys):
            put(inbox, DETECTIONS, sequence, f"k{sequence}")

    def pass_one(inbox: Inbox) -> None:
        put(inbox, DETECTIONS, 7, "next")
        inbox.get(0.0)

    pass_one(few)  # imports and caches
    assert calls_of(lambda: pass_one(many)) < calls_of(lambda: pass_one(few)) + 50


def test_tickets_count_what_was_taken_out() -> None:
    inbox = Inbox()
    for sequence in (7, 8):
        put(inbox, DETECTIONS, sequence)
    first, second = inbox.get(0.0), inbox.get(0.0)
    assert first
    assert second
    assert (first.ticket, second.ticket) == (0, 1)
    assert first.received_ns <= first.decoded_ns <= second.decoded_ns


def test_gaps_are_counted_by_sequence() -> None:
    # From 4 to 7, messages 5 and 6 are lost; a repeated 7 loses none; from 7 to 0 the camera was
    # restarted; from 0 to 2, message 1 is lost.
    inbox = Inbox()
    for sequence in (4, 7, 7, 0, 2):
        put(inbox, FRAMES, sequence)
        inbox.get(0.0)
    assert inbox.counters["gaps_frames"] == 2 + 1


def test_gaps_are_counted_by_camera() -> None:
    inbox = Inbox()
    for sequence, key in ((1, "left"), (9, "right"), (2, "left"), (10, "right")):
        put(inbox, FRAMES, sequence, key)
    assert inbox.counters["gaps_frames"] == 0


def test_gaps_of_tracks_are_counted_by_camera() -> None:
    # left: 3 and 4 never arrived; right: 11; both arrive on the key of all tracks.
    inbox = Inbox()
    for sequence, camera in ((2, "left"), (10, "right"), (5, "left"), (12, "right"), (13, "right")):
        tracks = msgspec.structs.replace(EXAMPLES["Tracks"], sequence=sequence, camera=camera)
        inbox.add_payload(BY_NAME["people"], "people", encode(tracks))
    assert inbox.counters["gaps_people"] == 2 + 1


def test_counters_of_the_largest_gaps_can_be_encoded() -> None:
    # Counters of 64 bits must not overflow after two such messages and silence the heartbeat.
    inbox = Inbox()
    for sequence in (0, 2**53 - 1) * 100:
        put(inbox, FRAMES, sequence)
    health = msgspec.structs.replace(EXAMPLES["Health"], counters=dict(inbox.counters))
    assert encode(health)


def test_bytes_that_do_not_decode_are_counted_with_the_error() -> None:
    inbox = Inbox()
    assert not inbox.last_error_is_fresh()
    inbox.add_payload(DETECTIONS, "k", b"\xc1")
    assert inbox.counters == {"bad_detections": 1}
    assert inbox.last_error.startswith("message: expected MessagePack")
    assert inbox.last_error_is_fresh()
    assert inbox.get(0.0) is None


def test_error_is_fresh_for_three_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    inbox, now_s = Inbox(), 100.0
    monkeypatch.setattr("time.monotonic", lambda: now_s)
    inbox.add_payload(DETECTIONS, "k", b"\xc1")
    now_s += 2.9
    assert inbox.last_error_is_fresh()
    now_s += 0.1
    assert not inbox.last_error_is_fresh()


def test_message_of_another_topic_is_counted_with_the_error() -> None:
    inbox = Inbox()
    inbox.add_payload(DETECTIONS, "k", encode(EXAMPLES["Truth"]))
    assert inbox.counters == {"bad_detections": 1}
    assert inbox.last_error == "detections: expected Detections, got Truth"


def test_wake_ends_a_wait_once_and_is_not_lost() -> None:
    inbox = Inbox()
    inbox.wake()
    assert inbox.get(WAIT_S) is None
    got: list[Arrival | None] = []
    done = threading.Thread(target=lambda: got.append(inbox.get(None)))
    done.start()
    inbox.wake()
    done.join(WAIT_S)
    assert got == [None]


def test_a_message_ends_a_wait() -> None:
    inbox = Inbox()
    got: list[int] = []

    def wait() -> None:
        arrival = inbox.get(WAIT_S)
        got.append(arrival.message.sequence if arrival else -1)

    waiting = threading.Thread(target=wait)
    waiting.start()
    put(inbox, DETECTIONS, 5)
    waiting.join(WAIT_S)
    assert got == [5]


def test_no_message_is_lost_or_repeated_among_many_threads() -> None:
    # Four keys of 50 messages each fit, in any order of threads.
    inbox = Inbox()
    lock, tickets = threading.Lock(), []

    def write(key: str) -> None:
        for sequence in range(50):
            put(inbox, DETECTIONS, sequence, key)

    written = threading.Event()

    def read() -> None:
        while (arrival := inbox.get(0.05)) or not written.is_set():
            if arrival:
                with lock:
                    tickets.append(arrival.ticket)

    readers = [threading.Thread(target=read) for _ in range(3)]
    writers = [threading.Thread(target=write, args=(key,)) for key in "abcd"]
    for thread in (*readers, *writers):
        thread.start()
    for thread in writers:
        thread.join(WAIT_S)
    written.set()
    for thread in readers:
        thread.join(WAIT_S)
    assert sorted(tickets) == list(range(200))
    assert inbox.counters == {"received_detections": 200}


def test_foreign_topic_is_read_by_its_own_decoder() -> None:
    def read_count(payload: bytes) -> Message:
        if not payload.isdigit():
            raise DecodeError("count: expected digits, got other bytes")
        return builders.truth(stamp_ns=int(payload))

    topic = ForeignTopic("counts", "their/key", Truth, 10, "queue", 8, "they", read_count)
    assert topic.key_expression("robot") == "their/key"  # below no robot's prefix
    inbox = Inbox()
    for payload in (b"7", b"seven", encode(EXAMPLES["Truth"]), b"8"):
        inbox.add_payload(topic, "their/key", payload)
    first, second = inbox.get(0.0), inbox.get(0.0)
    assert first is not None
    assert second is not None
    assert [first.message.stamp_ns, second.message.stamp_ns] == [7, 8]
    assert inbox.counters["bad_counts"] == 2
    assert inbox.last_error == "count: expected digits, got other bytes"


def test_several_frames_wait_if_the_node_wants_them() -> None:
    inbox = Inbox(frames_waiting=3)
    for sequence in range(5):
        put(inbox, FRAMES, sequence)
    assert taken(inbox) == [2, 3, 4]
    assert inbox.counters == {"received_frames": 5, "dropped_frames": 2}


def test_many_invented_keys_are_bounded_and_cost_nothing_once_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("people4d.queue.WAITING_MAX", 100)
    monkeypatch.setattr("people4d.queue.SOURCES_MAX", 100)
    inbox = Inbox()
    for sequence in range(1000):
        put(inbox, DETECTIONS, sequence, f"k{sequence}")
    assert inbox.counters["dropped_detections"] == 900
    assert taken(inbox) == list(range(900, 1000))
    assert not inbox._queues
    assert len(inbox._last) == 100


def test_what_waits_is_bounded_in_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    size = len(encode(EXAMPLES["Detections"]))
    monkeypatch.setattr("people4d.queue.WAITING_MAX_BYTES", 10 * size)
    inbox = Inbox()
    for sequence in range(30):
        put(inbox, DETECTIONS, sequence, f"k{sequence % 3}")
    assert taken(inbox) == list(range(20, 30))  # ten messages fit exactly
    assert inbox.counters["dropped_detections"] == 20
    assert (inbox._waiting, inbox._waiting_bytes) == (0, 0)


def test_a_message_of_this_process_is_added_as_it_is() -> None:
    inbox, frame = Inbox(), EXAMPLES["RgbdFrame"]
    inbox.add_message(BY_NAME["frames"], "k", frame)
    arrival = inbox.get(0.0)
    assert arrival is not None
    assert arrival.message is frame
    assert arrival.size == frame.rgb.nbytes + frame.depth_mm.nbytes  # type: ignore[attr-defined]
    assert inbox.counters["received_frames"] == 1


def test_a_frame_of_this_process_goes_to_one_replica_and_to_the_other_if_that_leaves() -> None:
    assignment = Assignment("detector-1", Sharing(RgbdFrame, Detections))
    for name in ("detector-1", "detector-2"):
        assignment.add_replica(name, 0.0)
        assignment.note_heartbeat(name, stalled=False, now_s=1e9)
    inbox = Inbox(assignment)
    frames = [
        msgspec.structs.replace(EXAMPLES["RgbdFrame"], sequence=k, lockstep=True) for k in range(6)
    ]
    for frame in frames:
        inbox.add_message(BY_NAME["frames"], "k", frame)
    first = taken(inbox)
    assert first in ([0, 2, 4], [1, 3, 5])
    assert inbox.counters["left_frames"] == 3
    for message in assignment.remove_replica("detector-2", 0.0):
        inbox.take_over(message)
    assert sorted([*first, *taken(inbox)]) == list(range(6))
    assert inbox.counters["taken_over_frames"] == 3
