"""people4d record."""

import time
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from common.io.recording import RecordingWriter
from deploy.cli.options import Connect, Robot, open_client
from people4d.errors import ConfigError
from people4d.messages import Message
from people4d.topics import BY_NAME

USUAL = ("camera_info", "static_transforms", "odometry", "detections", "embeddings", "people")


def record(
    file: Annotated[Path, typer.Argument(help="The recording, for example out.mcap.")],
    topics: Annotated[
        str, typer.Option(help=f"Topics with commas between: {', '.join(BY_NAME)}.")
    ] = ",".join(USUAL),
    seconds: Annotated[
        float | None, typer.Option("--for", help="Seconds to record; else until Ctrl-C.")
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
    counts: dict[str, int] = {}
    with open_client(connect, robot) as client, RecordingWriter(file) as writer:
        typer.echo(f"Recording {topics} to {file}; Ctrl-C ends it.", err=True)
        with suppress(KeyboardInterrupt):
            for message in client.messages(*kinds, timeout_s=seconds):
                writer.write(message, time.time_ns())
                name = type(message).__name__
                counts[name] = counts.get(name, 0) + 1
                if time.monotonic() > deadline_s:
                    break
    typer.echo("Recorded " + (", ".join(f"{n} {c}" for n, c in counts.items()) or "nothing"))


def kinds_of(topics: str) -> tuple[type[Message], ...]:
    """Return the message types of topics named with commas between.

    Raises:
        ConfigError: There is no such topic.
    """
    names = [name.strip() for name in topics.split(",") if name.strip()]
    for name in names:
        if name not in BY_NAME:
            raise ConfigError(f"there is no topic {name!r}", f"Topics are {', '.join(BY_NAME)}.")
    return tuple(BY_NAME[name].message for name in names)
