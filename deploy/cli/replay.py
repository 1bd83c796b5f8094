"""people4d replay."""

import time
from collections.abc import Iterator
from contextlib import closing, suppress
from itertools import count
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from common.io.images import decompress, encode_png16
from common.io.recording import Recording, open_recording
from common.transport.zenoh_bus import ZenohBus
from deploy.cli.options import Connect, Robot, open_bus
from deploy.cli.record import kinds_of
from lab.depth.metadata import CleanDepthSensor, read_metadata
from people4d.errors import ConfigError
from people4d.messages import CameraInfo, CompressedRgbdFrame, Message, RgbdFrame
from people4d.topics import BY_MESSAGE

MEET_S = 1.0


def replay(
    file: Annotated[Path, typer.Argument(help="A people4d recording.")],
    topics: Annotated[
        str, typer.Option(help="Topics with commas between; frames come as recorded. All if none.")
    ] = "",
    clean_depth: Annotated[
        bool,
        typer.Option("--clean-depth", help="Simulated depth as stored, without a sensor's errors."),
    ] = False,
    speed: Annotated[float, typer.Option(min=0.01, help="Times the recorded rate.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Again and again, until Ctrl-C.")] = False,
    hold_s: Annotated[
        float, typer.Option("--hold", help="Seconds to stay at the end, for late joiners.")
    ] = 1.0,
    force: Annotated[
        bool, typer.Option("--force", help="Publish beside services that publish the same topics.")
    ] = False,
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Publish recorded messages as their service would, so that another runs alone against them."""
    recording = open_recording(file)
    kinds = kinds_of(topics)
    wanted = tuple(CompressedRgbdFrame if kind is RgbdFrame else kind for kind in kinds)
    if not any(True for _ in recording.messages(*wanted)):
        found = ", ".join(recording.summary.topics) or "nothing"
        raise ConfigError(
            f"{file} holds no message of {topics or 'any topic'}", f"It holds {found}."
        )
    sensors = {} if clean_depth else clean_cameras(recording)
    sent = 0
    with closing(open_bus(connect, robot)) as bus, suppress(KeyboardInterrupt):
        if not force:
            check_publishers(bus, robot, {type(m) for _, m in recording.messages(*wanted)})
        # Subscribers and this publisher need a moment to learn of each other.
        time.sleep(MEET_S)
        for _ in count() if loop else range(1):
            for message in paced(recording, wanted, speed):
                if isinstance(message, CompressedRgbdFrame):
                    pixels = not kinds or RgbdFrame in kinds
                    message = frame_of(message, sensors.get(message.camera), pixels)
                # The times of its trace were those of the recording.
                bus.publish(msgspec.structs.replace(message, trace=()))
                sent += 1
        time.sleep(hold_s)
    typer.echo(f"Published {sent} messages.")


def check_publishers(bus: ZenohBus, robot: str, kinds: set[type[Message]]) -> None:
    """Check that no live service publishes what is to be replayed.

    Args:
        bus: Bus of the robot.
        robot: Name of the robot.
        kinds: Types of the recorded messages.

    Raises:
        ConfigError: A service does: its messages and the recorded ones would mix.
    """
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
    """Return the depth sensor of each camera; none if depth is not clean.

    Raises:
        SourceError: The recording's metadata of its simulation are damaged.
    """
    metadata = read_metadata(recording)
    if metadata is None or metadata.depth != "clean":
        return {}
    infos = [info for _, info in recording.messages(CameraInfo) if isinstance(info, CameraInfo)]
    return {info.camera: CleanDepthSensor(metadata, info, {}) for info in infos}


def frame_of(message: CompressedRgbdFrame, clean: CleanDepthSensor | None, pixels: bool) -> Message:
    """Return a recorded frame as it is to be published.

    Args:
        message: As recorded.
        clean: Reads its depth as a sensor would; None if depth is as a sensor read it.
        pixels: Whether it goes out with its pixels, or compressed.

    Raises:
        DecodeError: An image is corrupt.
    """
    if clean is None:
        return decompress(message) if pixels else message
    frame = decompress(message)
    depth_mm = clean.measure(frame.depth_mm, frame.stamp_ns)
    if pixels:
        return msgspec.structs.replace(frame, depth_mm=depth_mm)
    return msgspec.structs.replace(message, depth_png=encode_png16(depth_mm))


def paced(
    recording: Recording, kinds: tuple[type[Message], ...], speed: float
) -> Iterator[Message]:
    """Yield the messages of a recording when they are due.

    Args:
        recording: The recording.
        kinds: Types wanted, all if none.
        speed: 1 for the recorded rate, 2 for twice as fast.
    """
    start_ns, begin_s = None, time.monotonic()
    for log_ns, message in recording.messages(*kinds):
        start_ns = log_ns if start_ns is None else start_ns
        due_s = begin_s + (log_ns - start_ns) / 1e9 / speed
        time.sleep(max(0.0, due_s - time.monotonic()))
        yield message
