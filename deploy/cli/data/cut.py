"""Command `people4d cut`."""

from pathlib import Path
from typing import Annotated

import typer

from common.io.recording import RecordingWriter, open_recording
from deploy.cli.data.spans import End, RecordingSpan, Start
from deploy.cli.data.targets import Force, check_target


def cut(
    source: Annotated[Path, typer.Argument(help="A people4d recording.")],
    target: Annotated[Path, typer.Argument(help="The recording to write.")],
    start_s: Start = 0.0,
    end_s: End = None,
    force: Force = False,
) -> None:
    """Write a part of a recording to another one, with calibration and transforms from before."""
    check_target(target, source, force)
    recording = open_recording(source)
    span = RecordingSpan(start_s, end_s)
    span.check(recording)
    count = 0
    with RecordingWriter(target) as writer:
        for name, values in recording.metadata.items():
            writer.write_metadata(name, values)
        for log_time_ns, message in span.messages(recording):
            writer.write(message, log_time_ns)
            count += 1
    typer.echo(f"Wrote {count} messages to {target}.")
    if recording.bad_messages:
        typer.echo(f"{recording.bad_messages} messages could not be decoded and were left out.")
    if recording.summary.truncated:
        typer.echo(f"{source} is cut short or damaged; the messages before are there.")
