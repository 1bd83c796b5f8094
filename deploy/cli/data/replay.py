"""Command `people4d replay`."""

import time
from collections.abc import Iterable, Iterator
from contextlib import closing, suppress
from itertools import count
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from common.io.images import decompress, encode_png16
from common.io.recording import Recording, open_recording
from common.transport.zenoh_bus import ZenohBus
from deploy.cli.data.spans import End, RecordingSpan, Start
from deploy.cli.options import Connect, Robot, kinds_of, open_bus
from lab.depth.metadata import CleanDepthSensor, read_metadata
from people4d.errors import ConfigError
from people4d.messages import CameraInfo, CompressedRgbdFrame, Message, RgbdFrame
from people4d.topics import BY_MESSAGE, prefix, topic_of_key

MEET_S = 1.0


def replay(
    file: Annotated[Path, typer.Argument(help="A people4d recording.")],
    topics: Annotated[
        str, typer.Option(help="Topics, separated by commas; frames as recorded. Default: all.")
    ] = "",
    clean_depth: Annotated[
        bool,
        typer.Option(
            "--clean-depth", help="Simulated depth as stored, without the errors of a sensor."
        ),
    ] = False,
    rate: Annotated[float, typer.Option(min=0.01, help="Multiple of the recorded rate.")] = 1.0,
    start_s: Start = 0.0,
    end_s: End = None,
    loop: Annotated[bool, typer.Option("--loop", help="Repeat until Ctrl-C.")] = False,
    hold_s: Annotated[
        float,
        typer.Option("--hold", help="Seconds to stay connected at the end, for late subscribers."),
    ] = 1.0,
    force: Annotated[
        bool,
        typer.Option(
            "--force", help="Publish even if a running service publishes the same topics."
        ),
    ] = False,
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Publish recorded messages in place of their service, so that another service runs alone."""
    recording = open_recording(file)
    kinds = kinds_of(topics)
    wanted = tuple(CompressedRgbdFrame if kind is RgbdFrame else kind for kind in kinds)
    span = RecordingSpan(start_s, end_s)
    span.check(recording)
    if not any(True for _ in span.messages(recording, *wanted)):
        found = ", ".join(recording.summary.topics) or "nothing"
        raise ConfigError(
            f"{file} holds no message of {topics or 'any topic'}", f"It holds {found}."
        )
    sensors = {} if clean_depth else clean_cameras(recording)
    sent = 0
    with closing(open_bus(connect, robot)) as bus, suppress(KeyboardInterrupt):
        if not force:
            check_publishers(bus, robot, recorded_kinds(recording) & set(wanted or BY_MESSAGE))
        # Subscribers and this publisher need some time to discover each other.
        time.sleep(MEET_S)
        for _ in count() if loop else range(1):
            for _, message in paced(span.messages(recording, *wanted), rate):
                if isinstance(message, CompressedRgbdFrame):
                    pixels = not kinds or RgbdFrame in kinds
                    message = frame_of(message, sensors.get(message.camera), pixels)
                # without the trace, whose times are of the recording
                bus.publish(msgspec.structs.replace(message, trace=()))
                sent += 1
        time.sleep(hold_s)
    typer.echo(f"Published {sent} messages.")


def recorded_kinds(recording: Recording) -> set[type[Message]]:
    """Return the message types of a recording, from its index."""
    topics = (topic_of_key(f"{prefix('*')}/{name}") for name in recording.summary.topics)
    return {topic.message for topic in topics if topic}


def check_publishers(bus: ZenohBus, robot: str, kinds: set[type[Message]]) -> None:
    """Check that no live service publishes the replayed topics."""
    topics = [BY_MESSAGE[kind] for kind in kinds]
    if CompressedRgbdFrame in kinds:
        topics.append(BY_MESSAGE[RgbdFrame])
    alive = {service for name, service, _ in bus.present() if name == robot}
    for service in sorted(alive):
        mixed = sorted(topic.name for topic in topics if service in topic.producers)
        if mixed:
            raise ConfigError(
                f"{service} of robot {robot} publishes {', '.join(mixed)}: the streams would mix",
                "Name other topics with --topics or another --robot; --force replays all the same.",
            )


def clean_cameras(recording: Recording) -> dict[str, CleanDepthSensor]:
    """Return the depth sensor of each camera; none if depth is not clean."""
    metadata = read_metadata(recording)
    if metadata is None or metadata.depth != "clean":
        return {}
    infos = [info for _, info in recording.messages(CameraInfo) if isinstance(info, CameraInfo)]
    return {info.camera: CleanDepthSensor(metadata, info, {}) for info in infos}


def frame_of(message: CompressedRgbdFrame, clean: CleanDepthSensor | None, pixels: bool) -> Message:
    """Return a recorded frame for publication: with its pixels, or compressed.

    `clean` adds the errors of a sensor to simulated depth; None for measured depth.
    """
    frame = decompress(message) if pixels or clean else None
    if frame is None or clean is None:
        return frame or message
    depth_mm = clean.measure(frame.depth_mm, frame.stamp_ns)
    if pixels:
        return msgspec.structs.replace(frame, depth_mm=depth_mm)
    return msgspec.structs.replace(message, depth_png=encode_png16(depth_mm))


def paced(messages: Iterable[tuple[int, Message]], rate: float) -> Iterator[tuple[int, Message]]:
    """Yield messages with their log times [ns] when they are due, at a multiple of the rate."""
    start_ns, begin_s = None, time.monotonic()
    for log_ns, message in messages:
        start_ns = log_ns if start_ns is None else start_ns
        due_s = begin_s + (log_ns - start_ns) / 1e9 / rate
        time.sleep(max(0.0, due_s - time.monotonic()))
        yield log_ns, message
