"""The camera node, alone and in the run loop."""

import math
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from common.io.images import decompress
from common.runtime.node import LoopCallbacks
from common.transport.trace import ProcessId, collect
from people4d.errors import ConfigError, SourceError
from people4d.messages import (
    CameraInfo,
    CompressedRgbdFrame,
    Message,
    Odometry,
    RgbdFrame,
    StaticTransform,
    Tracks,
)
from services.camera.calibration import static_transform
from services.camera.config import CameraConfig
from services.camera.node import CameraNode
from services.camera.source import Source, SourceFrame
from tests import builders
from tests.camera.memory import SIZE, MemorySource, capture, odometry

MS = 1_000_000
SECOND = 1_000_000_000
START = CameraConfig(start_delay_s=0.0)


class Player:
    """Ticks a node at times of the test's choosing, waiting for its thread instead of sleeping."""

    def __init__(self, node: CameraNode) -> None:
        self.node = node
        self.now_ns = 0
        self.out: list[Message] = []
        self.news = threading.Event()
        node.attach(LoopCallbacks(wake=self.news.set))

    def frames(self) -> list[RgbdFrame]:
        return [message for message in self.out if isinstance(message, RgbdFrame)]

    def tick(self, now_ms: int = 0) -> None:
        self.now_ns = max(self.now_ns, now_ms * MS)
        self.out += self.node.tick(self.now_ns)

    def until(self, done: Callable[[], bool], follow: bool = False) -> None:
        """Tick at every event until done; `follow` advances the time to the next due event."""
        for _ in range(10_000):
            self.news.clear()
            self.tick()
            if done():
                return
            wake_ns = self.node.wake_ns()
            if follow and wake_ns is not None:
                self.now_ns = max(self.now_ns, wake_ns)
            elif not self.news.wait(5.0):
                break
        raise AssertionError(f"not done: {self.node.status()}")

    def play(self) -> None:
        self.until(lambda: self.node.status().state == "finished", follow=True)


@contextmanager
def player(config: CameraConfig, source: Source) -> Iterator[Player]:
    node = CameraNode(config, source)
    try:
        yield Player(node)
    finally:
        node.close()


def with_(**settings: object) -> CameraConfig:
    return CameraConfig(**({"start_delay_s": 0.0} | settings))  # type: ignore[arg-type]


def answer(stamp_ns: int, camera: str = "camera") -> Tracks:
    return builders.tracks(stamp_ns=stamp_ns, camera=camera)


def test_calibration_then_frames_then_the_end() -> None:
    source = MemorySource([capture(0), odometry(50), capture(100), capture(200)])
    with player(START, source) as p:
        assert p.node.status().state == "starting"
        p.play()
        # No frame is compressed unless configured.
        kinds = [CameraInfo, StaticTransform, RgbdFrame, Odometry, RgbdFrame, RgbdFrame]
        assert [type(message) for message in p.out] == kinds
        assert [frame.sequence for frame in p.frames()] == [0, 1, 2]
        assert [frame.stamp_ns for frame in p.frames()] == [0, 100 * MS, 200 * MS]
        assert not any(frame.lockstep for frame in p.frames())
        assert all(frame.trace == () for frame in p.frames())  # not in the critical path
        assert p.now_ns == 200 * MS
    assert source.closed


def test_recorded_rate_holds_frames_back() -> None:
    with player(with_(speed=2.0), MemorySource([capture(0), capture(100)])) as p:
        p.until(lambda: len(p.frames()) == 1)
        p.until(lambda: p.node.wake_ns() == 50 * MS)  # the second frame was read and is not due
        p.tick(49)
        assert len(p.frames()) == 1
        p.tick(50)
        assert len(p.frames()) == 2


def test_compressed_frames_follow_their_frames_at_their_own_rate() -> None:
    # At most one frame every 200 ms: the first and third of frames at 0, 100, 200, 300 ms.
    source = MemorySource([capture(n) for n in (0, 100, 200, 300)])
    with player(with_(compressed_hz=5.0), source) as p:
        p.play()
        images = [m for m in p.out if isinstance(m, RgbdFrame | CompressedRgbdFrame)]
        assert [(type(m), m.stamp_ns // MS) for m in images] == [
            (RgbdFrame, 0),
            (CompressedRgbdFrame, 0),
            (RgbdFrame, 100),
            (RgbdFrame, 200),
            (CompressedRgbdFrame, 200),
            (RgbdFrame, 300),
        ]
        leaving = images[1]
        assert isinstance(leaving, CompressedRgbdFrame)
        np.testing.assert_array_equal(decompress(leaving).depth_mm, p.frames()[0].depth_mm)


def test_frames_wait_for_the_start_delay() -> None:
    with player(with_(start_delay_s=0.3), MemorySource([capture(0)])) as p:
        p.tick()
        assert p.node.wake_ns() == 300 * MS
        p.tick(299)
        assert p.frames() == []
        p.play()
        assert len(p.frames()) == 1


def test_frames_of_a_live_camera_do_not_wait_for_the_start_delay() -> None:
    with player(with_(start_delay_s=100.0), MemorySource([capture(0)], live=True)) as p:
        p.until(lambda: len(p.frames()) == 1)


def test_the_process_loads_no_library_that_only_some_sources_need() -> None:
    # A restarted camera is silent during its imports.
    code = "import sys, services.camera.__main__; print(*sorted(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"scipy", "rosbags", "numba", "onnxruntime"}.intersection(done.stdout.split())


def test_lockstep_sends_the_next_frame_on_the_answer() -> None:
    source = MemorySource([capture(k) for k in range(5)])
    with player(with_(playback="lockstep"), source) as p:
        p.until(lambda: len(p.frames()) == 2)
        p.tick(1000)
        assert len(p.frames()) == 2  # two are unanswered
        assert all(frame.lockstep for frame in p.frames())
        p.node.handle(answer(0, camera="other"), p.now_ns)
        p.tick()
        assert len(p.frames()) == 2
        for stamp_ms in range(5):
            p.node.handle(answer(stamp_ms * MS), p.now_ns)
            p.until(lambda n=stamp_ms: len(p.frames()) >= min(n + 3, 5))  # type: ignore[misc]
        assert p.node.status().state == "finished"
        assert "unanswered" not in p.node.status().counters


def test_reading_ahead_is_bounded() -> None:
    # One frame sent, four wait, and one is in the hands of the thread that reads.
    read: list[int] = []

    class Counting(MemorySource):
        def __iter__(self) -> Iterator[SourceFrame | Odometry]:
            for k in range(500):
                read.append(k)
                yield capture(k)

    with player(with_(playback="lockstep", window=1), Counting([])) as p:
        p.until(lambda: len(p.frames()) == 1)
        while len(read) < 6:
            p.tick()
        p.node.close()  # waits for the thread to finish the present read
        assert len(read) == 6


def test_lockstep_goes_on_without_answers() -> None:
    source = MemorySource([capture(k) for k in range(3)])
    config = with_(playback="lockstep", window=1, answer_timeout_s=2.0)
    with player(config, source) as p:
        p.play()
        assert [frame.stamp_ns for frame in p.frames()] == [0, MS, 2 * MS]
        assert p.now_ns == 6 * SECOND  # three frames without an answer, two seconds each
        assert p.node.status().counters["unanswered"] == 3
        assert p.node.status().reason == "frames get no answer on people"
        p.node.handle(answer(99), p.now_ns)
        assert p.node.status().reason == ""


def test_lockstep_may_be_answered_by_detections() -> None:
    config = with_(playback="lockstep", window=1, answer="detections")
    with player(config, MemorySource([capture(0), capture(1)])) as p:
        p.until(lambda: len(p.frames()) == 1)
        p.node.handle(answer(0), 0)
        p.tick()
        assert len(p.frames()) == 1
        detections = builders.detections(camera="camera", frame_id="f", width=8, height=6)
        p.node.handle(detections, 0)
        p.until(lambda: len(p.frames()) == 2)


def test_live_camera_gives_its_newest_frame() -> None:
    done = threading.Event()

    class Live(MemorySource):
        def __iter__(self) -> Iterator[SourceFrame | Odometry]:
            yield from (capture(k) for k in range(20))
            done.set()
            yield capture(99)
            threading.Event().wait(0.01)

    with player(START, Live([], live=True)) as p:
        p.tick()
        assert done.wait(5.0)
        p.until(lambda: bool(p.frames()) and p.frames()[-1].stamp_ns == 99 * MS)
        sent, counters = len(p.frames()), p.node.status().counters
        assert sent < 20
        assert counters["skipped"] == 21 - sent


@pytest.mark.slow
def test_live_camera_that_fails_is_opened_again() -> None:
    class Flaky(MemorySource):
        attempts = 0

        def __iter__(self) -> Iterator[SourceFrame | Odometry]:
            self.attempts += 1
            if self.attempts == 1:
                raise OSError("unplugged")
            yield capture(self.attempts)

    with player(START, Flaky([], live=True)) as p:
        p.tick()
        p.until(lambda: p.node.status().state == "degraded")
        assert p.node.status().reason == "unplugged"
        p.until(lambda: len(p.frames()) == 1)
        assert p.node.status().counters["source_errors"] == 1
        assert p.node.status().reason == ""


def test_damage_in_the_middle_ends_playback_with_its_reason() -> None:
    source = MemorySource([capture(0), capture(1), SourceError("bag x is damaged"), capture(2)])
    with player(START, source) as p:
        p.play()
        assert len(p.frames()) == 2
        status = p.node.status()
        assert (status.state, status.reason) == ("finished", "bag x is damaged")
        assert status.counters["source_errors"] == 1


def test_a_source_without_frames_says_so() -> None:
    with player(START, MemorySource([odometry(0)])) as p:
        p.play()
        assert p.node.status().reason == "the source had no frame that could be played"


def test_frames_that_do_not_fit_are_counted() -> None:
    float_depth = SourceFrame(np.zeros((6, 8, 3), np.uint8), np.zeros((6, 8), np.float32), 3 * MS)
    source = MemorySource(
        [capture(0), capture(1, depth_size=(3, 4)), capture(2, (3, 4), (3, 4)), float_depth]
    )
    with player(START, source) as p:
        p.play()
        assert len(p.frames()) == 1
        assert p.node.status().counters == {"wrong_size": 2, "wrong_type": 1}


def test_clock_jumps_are_counted_and_not_waited_for() -> None:
    # 40 ms apart, then an hour ahead, then back: 0, 40, 80, 120, 160 ms of playing.
    stamps_ms = [0, 40, 3_600_000, 3_600_040, 80]
    with player(START, MemorySource([capture(t) for t in stamps_ms])) as p:
        p.play()
        assert [frame.stamp_ns // MS for frame in p.frames()] == stamps_ms
        assert p.now_ns == 160 * MS
        assert p.node.status().counters == {"stamp_jumps": 2}


def test_loop_never_steps_back() -> None:
    source = MemorySource([capture(0), capture(100)])
    with player(with_(loop=True, max_frames=7), source) as p:
        p.play()
        stamps = [frame.stamp_ns // MS for frame in p.frames()]
        assert stamps == [0, 100, 200, 300, 400, 500, 600]
        assert [frame.sequence for frame in p.frames()] == list(range(7))
        assert p.node.status().counters == {}


def test_mount_is_camera_link_in_the_map() -> None:
    # 1 m up, turned left by 90 deg: what the lens sees 2 m ahead (optical z) is at map y = 2; what
    # is 0.5 m right of the axis (optical x) is then 0.5 m along map's +x.
    config = with_(mount_xyz_m=(0, 0, 1), mount_rpy_rad=(0, 0, math.pi / 2), camera="front")
    with player(config, MemorySource([])) as p:
        p.tick()
        info, transform = p.out
        assert isinstance(info, CameraInfo)
        assert isinstance(transform, StaticTransform)
        assert (info.camera, info.frame_id) == ("front", "front_optical_frame")
        assert (transform.parent, transform.child) == ("map", "front_optical_frame")
        assert transform.matrix @ (0.5, 0, 2, 1) == pytest.approx([0.5, 2, 1, 1])


def test_transform_of_the_source_wins_over_the_mount() -> None:
    source = MemorySource([])
    matrix = np.eye(4)
    matrix[0, 3] = 7
    source.transforms = [static_transform("map", source.info.frame_id, matrix)]
    with player(with_(mount_xyz_m=(1, 1, 1), max_depth_m=3.0, camera="left"), source) as p:
        p.tick()
        info, transform = p.out
        assert isinstance(info, CameraInfo)
        assert isinstance(transform, StaticTransform)
        assert info.max_depth_m == 3.0
        assert transform.child == info.frame_id == "left_optical_frame"
        assert transform.matrix[0, 3] == 7


def test_calibrated_pose_wins_over_that_of_the_source(tmp_path: Path) -> None:
    file = tmp_path / "poses.toml"
    rows = "[[0, 0, 1, 2], [-1, 0, 0, 3], [0, -1, 0, 1], [0, 0, 0, 1]]"
    file.write_text(f'reference = "left"\n[cameras.left]\nframe_id = "x"\nmatrix = {rows}\n')
    source = MemorySource([])
    source.transforms = [static_transform("map", source.info.frame_id, np.eye(4))]
    with player(with_(transforms=str(file), camera="left"), source) as p:
        p.tick()
        (_, transform) = p.out
        assert isinstance(transform, StaticTransform)
        assert (transform.parent, transform.child) == ("map", "left_optical_frame")
        assert transform.matrix[:3, 3].tolist() == [2, 3, 1]


def test_without_a_wake_callback_the_node_asks_to_be_polled() -> None:
    gate = threading.Event()

    class Slow(MemorySource):
        def __iter__(self) -> Iterator[SourceFrame | Odometry]:
            gate.wait(5.0)
            yield capture(0)

    node = CameraNode(START, Slow([]))
    try:
        assert node.wake_ns() == 0
        node.tick(5)
        assert node.wake_ns() == 5 + 2 * MS
    finally:
        gate.set()
        node.close()


def test_a_live_camera_can_not_be_replayed_nor_a_recording_be_live() -> None:
    for playback in ("recorded", "lockstep"):
        with pytest.raises(ConfigError, match="for a live camera"):
            CameraNode(with_(playback=playback), MemorySource([], live=True))
    with pytest.raises(ConfigError, match="for a recording"):
        CameraNode(with_(playback="live"), MemorySource([]))


def test_a_live_frame_is_traced_from_its_acquisition() -> None:
    """a stamp on this clock; else by reading"""
    for stamp_ns, on_this_clock in ((time.time_ns() - 5 * MS, True), (0, False)):
        frame = replace(capture(0), stamp_ns=stamp_ns)
        with player(with_(max_frames=1), MemorySource([frame], live=True)) as p:
            with collect(ProcessId("camera", "camera-1", "robot")) as spans:
                p.play()
            assert p.frames()[0].trace == ()  # the loop writes them into the message
        captured, released = spans
        assert (captured.stage, released.stage) == ("camera.capture", "camera.release")
        assert (captured.start_ns == stamp_ns) is on_this_clock
        times = [captured.start_ns, captured.end_ns, released.start_ns, released.end_ns]
        assert times == sorted(times)


def test_stamps_that_stand_still_are_reported_with_the_remedy() -> None:
    source = MemorySource([capture(7)] * 30)
    with player(msgspec.structs.replace(START, playback="recorded"), source) as p:
        p.until(lambda: len(p.frames()) == 15, follow=True)
        status = p.node.status()
        assert status.state == "degraded"
        assert status.reason.startswith("the stamps of its frames stand still. Give each frame")
        assert status.counters["stamp_jumps"] == 14


def test_live_camera_ends_after_the_frames_wanted() -> None:
    with player(with_(max_frames=1), MemorySource([capture(0), capture(1)], live=True)) as p:
        p.play()
        assert [frame.stamp_ns for frame in p.frames()] == [0]


@pytest.mark.parametrize(
    "settings",
    [
        {"speed": 0},
        {"window": 0},
        {"stride": 0},
        {"start_s": -1},
        {"camera": "a/b"},
        {"camera": "a" * 51},
        {"max_depth_m": 0},
        {"mount_xyz_m": (math.nan, 0, 0)},
        {"answer_timeout_s": 0},
        {"compressed_hz": -1},
    ],
)
def test_configuration_is_checked(settings: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="expected"):
        with_(**settings)


def test_frames_of_wrong_size_are_reported_at_the_end() -> None:
    # The calibration of the source has another size than its one frame.
    source = MemorySource([capture(0)])
    source.info = msgspec.structs.replace(source.info, width=source.info.width + 1)
    with player(START, source) as p:
        p.play()
        reason = p.node.status().reason
    assert reason == "rgb is uint8 (6, 8, 3), expected uint8 (6, 9, 3) red first (wrong_size 1)"


def test_hopeless_camera_ends_with_the_reason_and_its_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # A missing frame must not hold `up` until its timeout with the status "starting: .".
    node = CameraNode(START, Wrong([], live=True))
    node.tick(0)
    while not node.status().counters:
        time.sleep(0)
    status, fault = node.status(), "depth_mm is float32 (6, 8), expected uint16 (6, 8) millimetres"
    assert (status.state, status.reason) == ("starting", fault)
    monkeypatch.setattr("services.camera.frame_check.HOPELESS_S", 0.0)
    while not node.is_finished():
        time.sleep(0)
    assert node.status().state == "finished"
    begin_s = time.monotonic()
    expected = "depth_mm is float32 .*, expected uint16 .* millimetres. .*depth_in_metres = True"
    with pytest.raises(SourceError, match=expected):
        node.close()
    assert time.monotonic() - begin_s < 1.0  # the thread ends without another frame


class Metres(MemorySource):
    """A camera that declares depth in metres."""

    depth_in_metres = True

    def __iter__(self) -> Iterator[SourceFrame | Odometry]:
        yield replace(capture(0), depth_mm=np.full(SIZE, 1.5, np.float32))


def test_declared_metres_are_published_as_millimetres() -> None:
    with player(START, Metres([])) as p:
        p.play()
    (frame,) = p.frames()
    assert (frame.depth_mm == 1500).all()


class Wrong(MemorySource):
    """A live camera with frames of the wrong size only."""

    def __iter__(self) -> Iterator[SourceFrame | Odometry]:
        while True:
            yield replace(capture(0), depth_mm=np.ones(SIZE, np.float32))
