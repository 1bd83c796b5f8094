"""The nodes of the services in one process, frame by frame, deterministic."""

import threading
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import msgspec

from common.runtime.node import LoopCallbacks, Node
from common.transport.memory_bus import MemoryBus
from common.transport.trace import ProcessId, collect
from people4d.errors import SourceError
from people4d.messages import Message, Span, Tracks
from services.camera.build import build as build_camera
from services.camera.config import CameraConfig
from services.detector.build import build as build_detector
from services.detector.config import DetectorConfig
from services.reid.build import build as build_reid
from services.reid.config import ReidConfig
from services.tracker.build import build as build_tracker
from services.tracker.config import TrackerConfig

TIMEOUT_S = 20.0
PROCESS = ProcessId("node", "chain", "")


@dataclass(frozen=True)
class PipelineStep:
    """Messages and times of one frame."""

    messages: list[Message]  # all published messages, the frame first
    spans: list[Span]  # time of each stage, without transport and codec

    @property
    def duration_ms(self) -> float:
        """Time of all stages in milliseconds."""
        return sum(span.end_ns - span.start_ns for span in self.spans) / 1e6


def pipeline(
    detector: DetectorConfig, reid: ReidConfig | None = None, tracker: TrackerConfig | None = None
) -> list[Node]:
    """Return the nodes of detector, re-identification and tracker."""
    return [
        build_detector(detector),
        build_reid(reid or ReidConfig()),
        build_tracker(tracker or TrackerConfig()),
    ]


def lockstep(camera: CameraConfig) -> CameraConfig:
    """Return the camera in lock-step: each frame follows the detections of the previous one."""
    return msgspec.structs.replace(
        camera, playback="lockstep", answer="detections", window=1, start_delay_s=0.0, loop=False
    )


def play(camera: CameraConfig, nodes: Sequence[Node]) -> Iterator[PipelineStep]:
    """Play a source in lock-step through detector and following nodes.

    SourceError if the source cannot be opened, or sends nothing for TIMEOUT_S.

    Yields:
        Calibration and transform, then one step a frame.
    """
    node = build_camera(camera)
    news = threading.Event()
    bus = MemoryBus([node, *nodes])
    node.attach(LoopCallbacks(wake=news.set))
    try:
        while node.status().state != "finished":
            news.clear()
            with collect(PROCESS) as spans:
                messages = bus.advance()
            bus.log.clear()
            if messages:
                yield PipelineStep(messages, spans)
            elif not news.wait(TIMEOUT_S):
                raise SourceError(f"{camera.source} gave nothing for {TIMEOUT_S:g} s")
    finally:
        node.close()


def track_again(messages: Iterable[Message], config: TrackerConfig) -> list[Tracks]:
    """Return the tracks of another tracker on the same detections and embeddings."""
    node = build_tracker(config)
    inputs = [message for message in messages if isinstance(message, node.inputs)]
    outputs = [output for message in inputs for output in node.handle(message, 0)]
    return [output for output in outputs if isinstance(output, Tracks)]
