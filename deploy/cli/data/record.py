"""Command `people4d record`."""

import time
from collections import Counter
from contextlib import closing, suppress
from pathlib import Path
from typing import Annotated

import typer

from common.io.recording import RecordingWriter
from deploy.anonymise.colourless import without_colour
from deploy.cli.data.targets import Force, check_target
from deploy.cli.options import Connect, Robot, kinds_of, open_client
from deploy.cli.terminal import signals_interrupt
from deploy.recorder.conditions import PERSON, Condition
from deploy.recorder.outputs import EventFiles, RecorderOutput, RotatingParts, SingleFile, part_path
from people4d.errors import ConfigError, SourceError
from people4d.topics import BY_NAME

USUAL = ("camera_info", "static_transforms", "odometry", "detections", "embeddings", "people")


def record(
    file: Annotated[Path, typer.Argument(help="The recording, for example out.mcap.")],
    topics: Annotated[
        str, typer.Option(help=f"Topics, separated by commas: {', '.join(BY_NAME)}.")
    ] = ",".join(USUAL),
    seconds: Annotated[
        float | None, typer.Option("--seconds", help="Seconds to record; default: until Ctrl-C.")
    ] = None,
    limit_mb: Annotated[
        float | None,
        typer.Option(
            "--limit", min=1.0, help="Megabytes: write parts FILE-0001 and on, delete the oldest."
        ),
    ] = None,
    last_s: Annotated[
        float | None,
        typer.Option(
            "--last", min=0.1, help="Seconds to hold in memory, and to write at an event (--on)."
        ),
    ] = None,
    on: Annotated[
        str, typer.Option(help=f"Event: {PERSON} (a new identity), or any message of a topic.")
    ] = PERSON,
    buffer_mb: Annotated[
        float, typer.Option("--buffer", min=1.0, help="Megabytes of memory for --last.")
    ] = 512.0,
    colour: Annotated[
        bool, typer.Option("--colour/--no-colour", help="Grey images in place of colour.")
    ] = True,
    force: Force = False,
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Record messages of a running system to a file; frames are compressed."""
    if limit_mb and last_s:
        raise ConfigError("--limit and --last exclude each other", "Leave one of them out.")
    first = part_path(file, 1) if limit_mb or last_s else file
    check_target(first, None, force)
    recorded = kinds_of(topics)
    condition = Condition(on)
    if last_s:
        recorded = tuple(dict.fromkeys((*recorded, condition.message)))

    def open_output() -> RecorderOutput:
        if limit_mb:
            return RotatingParts(file, limit_mb, RecordingWriter)
        if last_s:
            return EventFiles(file, last_s, condition, buffer_mb, RecordingWriter)
        return SingleFile(file, RecordingWriter)

    deadline_s = time.monotonic() + seconds if seconds else float("inf")
    counts: Counter[str] = Counter()
    # Without a system no file is opened, which would block the next try.
    with open_client(connect, robot) as client, closing(open_output()) as output:
        with suppress(KeyboardInterrupt), signals_interrupt():
            typer.echo(f"Recording {topics} to {file}; Ctrl-C ends it.", err=True)
            for message in client.messages(*recorded, timeout_s=seconds):
                shown = message if colour else without_colour(message)
                if shown is None:
                    continue
                try:
                    output.write(shown, time.time_ns())
                except SourceError as error:
                    total = sum(counts.values())
                    raise SourceError(
                        f"{error.problem}, after {total} messages", error.hint
                    ) from error
                counts[type(message).__name__] += 1
                if time.monotonic() > deadline_s:
                    break
        lost = {n: c for n, c in client.counters.items() if n.startswith(("dropped_", "bad_"))}
    typer.echo("Recorded " + (", ".join(f"{n} {c}" for n, c in counts.items()) or "nothing"))
    for text in (output.summary(), ", ".join(f"{n} {c}" for n, c in lost.items())):
        if text:
            typer.echo(text)
