"""people4d record and people4d replay."""

import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, suppress
from itertools import count
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from common.io.images import decompress, encode_png16
from common.io.recording import Recording, RecordingWriter, open_recording
from common.transport.zenoh_bus import ZenohBus
from deploy.cli.options import Connect, Robot, open_bus, open_client
from lab.depth.metadata import CleanDepthSensor, read_metadata
from people4d.errors import ConfigError
from people4d.messages import CameraInfo, CompressedRgbdFrame, Message, RgbdFrame
from people4d.topics import BY_MESSAGE, BY_NAME, prefix, topic_of_key

MEET_S = 1.0
USUAL = ("camera_info", "static_transforms", "odometry", "detections", "embeddings", "people")


def record(
    file: Annotated[Path, typer.Argument(help="The recording, for example out.mcap.")],
    topics: Annotated[
        str, typer.Option(help=f"Topics, separated by commas: {', '.join(BY_NAME)}.")
    ] = ",".join(USUAL),
    seconds: Annotated[
        float | None, typer.Option("--for", help="Seconds to record; default: until Ctrl-C.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file.")] = False,
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Record messages of a running system to a file; frames are compressed."""
    if file.exists() and not force:
        raise ConfigError(f"{file} exists", "Name another file, or overwrite it with --force.")
    kinds = kinds_of(topics)
    deadline_s = time.monotonic() + seconds if seconds else float("inf")
    counts: Counter[str] = Counter()
    with open_client(connect, robot) as client, RecordingWriter(file) as writer:
        typer.echo(f"Recording {topics} to {file}; Ctrl-C ends it.", err=True)
        with suppress(KeyboardInterrupt):
            for message in client.messages(*kinds, timeout_s=seconds):
                writer.write(message, time.time_ns())
                counts[type(message).__name__] += 1
                if time.monotonic() > deadline_s:
                    break
    typer.echo("Recorded " + (", ".join(f"{n} {c}" for n, c in counts.items()) or "nothing"))


def kinds_of(topics: str) -> tuple[type[Message], ...]:
    """Return the message types of topics named with commas between."""
    names = [name.strip() for name in topics.split(",") if name.strip()]
    for name in names:
        if name not in BY_NAME:
            raise ConfigError(f"there is no topic {name!r}", f"Topics are {', '.join(BY_NAME)}.")
    return tuple(BY_NAME[name].message for name in names)


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
    speed: Annotated[float, typer.Option(min=0.01, help="Multiple of the recorded rate.")] = 1.0,
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
            check_publishers(bus, robot, recorded_kinds(recording) & set(wanted or BY_MESSAGE))
        # Subscribers and this publisher need some time to discover each other.
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


def recorded_kinds(recording: Recording) -> set[type[Message]]:
    """Return the types of the messages of a recording, by its index: nothing is decoded."""
    topics = (topic_of_key(f"{prefix('*')}/{name}") for name in recording.summary.topics)
    return {topic.message for topic in topics if topic}


def check_publishers(bus: ZenohBus, robot: str, kinds: set[type[Message]]) -> None:
    """Check that no live service publishes what is to be replayed."""
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
    """Return a recorded frame as it is published: with its pixels, or compressed.

    `clean` reads depth as a sensor would; it is None if depth is as a sensor read it.
    """
    frame = decompress(message) if pixels or clean else None
    if frame is None or clean is None:
        return frame or message
    depth_mm = clean.measure(frame.depth_mm, frame.stamp_ns)
    if pixels:
        return msgspec.structs.replace(frame, depth_mm=depth_mm)
    return msgspec.structs.replace(message, depth_png=encode_png16(depth_mm))


def paced(
    recording: Recording, kinds: tuple[type[Message], ...], speed: float
) -> Iterator[Message]:
    """Yield the messages of a recording of some types, or all, when they are due."""
    start_ns, begin_s = None, time.monotonic()
    for log_ns, message in recording.messages(*kinds):
        start_ns = log_ns if start_ns is None else start_ns
        due_s = begin_s + (log_ns - start_ns) / 1e9 / speed
        time.sleep(max(0.0, due_s - time.monotonic()))
        yield message
