"""Bytes of every topic on the wire, from the shipped recording through all nodes in one process."""

import argparse
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.lib.table import markdown, write
from common.config import load
from common.io.images import compress
from common.runtime.node import Node
from evaluation.pipeline import pipeline, play
from people4d.codec import encode
from people4d.messages import Health, Message, RgbdFrame, Span
from people4d.topics import BY_MESSAGE, TOPICS
from services.camera.config import CameraConfig
from services.detector.config import DetectorConfig
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.node import GtBridgeNode
from services.gt_bridge.sources.registry import open_truth
from services.tracker.config import TrackerConfig

DEPLOY = Path(__file__).resolve().parents[1] / "deploy"
DEMO, SETTINGS = DEPLOY / "demo" / "crossing.mcap", DEPLOY / "config" / "people4d.toml"
# Stages in the trace of a message when it is sent: `benchmarks/latency.md` lists them.
STAGES = {"detections": 11, "crops": 11, "embeddings": 15, "people": 20, "score": 24}
SPAN = Span(
    stage="detector.postprocess",
    process="detector-1@robot",
    start_ns=1_767_225_600_000_000_000,
    end_ns=1_767_225_600_001_000_000,
)
HEALTH = Health(
    stamp_ns=SPAN.start_ns,
    sequence=1000,
    service="detector",
    instance="detector-1",
    host="robot",
    pid=4242,
    state="ready",
    counters={f"received_topic_{k}": 100_000 for k in range(12)},
    gauges={f"received_topic_{k}_hz": 29.97 for k in range(16)},
)


def messages(frames: int) -> Iterator[Message]:
    """Yield all messages of a run."""
    camera = CameraConfig(
        source=str(DEMO), playback="lockstep", start_delay_s=0.0, max_frames=frames
    )
    detector = load(DetectorConfig, "detector", SETTINGS, environment={})
    tracker = load(TrackerConfig, "tracker", SETTINGS, environment={})
    truth = GtBridgeNode(open_truth(GtBridgeConfig(truth=str(DEMO))))
    nodes: list[Node] = [*pipeline(detector, tracker=tracker), truth]
    for step in play(camera, nodes):
        for message in step.messages:
            yield message
            if isinstance(message, RgbdFrame):
                yield compress(message)
    yield HEALTH


def size(message: Message) -> int:
    """Return the bytes of a message with the trace that it has in a running system."""
    stages = STAGES.get(BY_MESSAGE[type(message)].name, 1)
    return len(encode(msgspec.structs.replace(message, trace=(SPAN,) * stages)))


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=0, help="of the recording; 0: all")
    sizes: dict[str, list[int]] = defaultdict(list)
    for message in messages(parser.parse_args().frames):
        sizes[BY_MESSAGE[type(message)].name].append(size(message))
    rows = []
    for topic in TOPICS:
        if topic.name not in sizes:
            continue
        bytes_ = np.array(sizes[topic.name])
        rows.append(
            [
                topic.name,
                f"{len(bytes_)}",
                f"{np.median(bytes_):,.0f}",
                f"{bytes_.max():,}",
                f"{topic.rate_hz:g}",
                f"{bytes_.mean() * topic.rate_hz * 8 / 1e6:.3f}",
            ]
        )
    traced = msgspec.structs.replace(HEALTH, trace=(SPAN,))
    header = ["topic", "messages", "median bytes", "largest", "rate [Hz]", "Mbit/s at that rate"]
    write(
        __file__,
        "Sizes of messages",
        "The shipped recording (640x480, three people, all in view most of the time), the shipped "
        "configuration. Rates are those of the table of streams (`people4d/topics.py`); the trace "
        "of a message has as many stages as in a running system. Health is a typical one, made up.",
        markdown(header, rows),
        f"One stage of a trace takes {len(encode(traced)) - len(encode(HEALTH))} bytes.",
    )


if __name__ == "__main__":
    main()
