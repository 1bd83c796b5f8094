"""Memory and size of the recorder over an hour at 30 Hz, faster than real time.

    python -m benchmarks.recorder [--minutes 60]

Frames of 64x48 with odometry, detections and tracks of three people go through each output of
`people4d record`; an event comes every ten minutes.
"""

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import psutil

from benchmarks.lib.table import markdown, write
from common.io.images import compress
from common.io.recording import RecordingWriter, open_recording
from deploy.recorder.conditions import TopicPublishes
from deploy.recorder.outputs import EventFiles, RecorderOutput, RotatingParts, SingleFile
from people4d.messages import Message, Odometry, RgbdFrame, StaticTransform, Track, Tracks, Truth

RATE_HZ = 30
EVENT_S = 600
HEADER = ("output", "messages", "files", "MB on disk", "MB of memory after 10 %", "after all", "µs")
NOTE = (
    "Memory: resident, of the process. µs: processor time of a message, frames of 64x48 included. "
    "One file: as `record`; parts: `--limit 20`; events: `--last 30 --on truth`, one every ten "
    "minutes."
)


def messages(minutes: float) -> Iterator[tuple[int, Message]]:
    """Yield log times and messages."""
    rng = np.random.default_rng(0)
    rgb = rng.integers(0, 255, (48, 64, 3), np.uint8)
    depth_mm = rng.integers(500, 5000, (48, 64)).astype(np.uint16)
    frame = compress(RgbdFrame(stamp_ns=0, sequence=0, camera="front", rgb=rgb, depth_mm=depth_mm))
    pose = StaticTransform(stamp_ns=0, sequence=0, parent="map", child="front", matrix=np.eye(4))
    yield 0, pose
    people = tuple(
        Track(
            id=k,
            state="confirmed",
            position_m=np.zeros(3),
            velocity_mps=np.zeros(3),
            covariance=np.eye(6),
            yaw_rad=0.0,
            hits=1,
            age=1,
            time_since_update_s=0.0,
            detection=None,
            score=0.9,
        )
        for k in (1, 2, 3)
    )
    tracks = Tracks(
        stamp_ns=0, sequence=0, frame_id="map", tracker="t", camera="front", tracks=people
    )
    odometry = Odometry(
        stamp_ns=0, sequence=0, frame_id="odom", child_frame_id="b", x_m=0, y_m=0, theta_rad=0
    )
    for k in range(round(minutes * 60 * RATE_HZ)):
        time_ns = round(k * 1e9 / RATE_HZ)
        for message in (frame, tracks, odometry):
            yield time_ns, message
        if k % (EVENT_S * RATE_HZ) == EVENT_S * RATE_HZ // 2:
            yield time_ns, Truth(stamp_ns=time_ns, sequence=k, frame_id="map")


def measure(name: str, make: Callable[[Path], RecorderOutput], minutes: float) -> list[str]:
    """Record all messages through an output; return a line of the table."""
    process, early_mb, count = psutil.Process(), 0.0, 0
    total = minutes * 60 * RATE_HZ * 3
    with tempfile.TemporaryDirectory() as folder:
        output, begin_s = make(Path(folder) / "x.mcap"), time.process_time()
        for log_time_ns, message in messages(minutes):
            output.write(message, log_time_ns)
            count += 1
            if not early_mb and count > total / 10:
                early_mb = process.memory_info().rss / 1e6
        late_mb = process.memory_info().rss / 1e6
        output.close()
        each_us = 1e6 * (time.process_time() - begin_s) / count
        files = sorted(Path(folder).iterdir())
        size_mb = sum(file.stat().st_size for file in files) / 1e6
        assert not any(open_recording(file).summary.truncated for file in files)
    cells = [f"{size_mb:.1f}", f"{early_mb:.1f}", f"{late_mb:.1f}", f"{each_us:.0f}"]
    return [name, str(count), str(len(files)), *cells]


def main() -> None:
    """Measure each output and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=60.0)
    minutes = parser.parse_args().minutes
    outputs: dict[str, Callable[[Path], RecorderOutput]] = {
        "parts": lambda path: RotatingParts(path, 20.0, RecordingWriter),
        "events": lambda path: EventFiles(path, 30.0, TopicPublishes(Truth), 512, RecordingWriter),
        "one file": lambda path: SingleFile(path, RecordingWriter),
    }
    lines = []
    for name, make in outputs.items():
        lines.append(measure(name, make, minutes))
        print(*lines[-1], sep=" | ", flush=True)
    write(__file__, "Memory of the recorder", NOTE, markdown(HEADER, lines))


if __name__ == "__main__":
    main()
