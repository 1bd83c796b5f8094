"""Command `people4d trace`."""

import json
import time
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from common.io.recording import open_recording
from deploy.chrome_trace import KINDS, FrameTraces
from deploy.cli.options import Connect, Robot, open_client
from people4d.errors import People4dError


def trace(
    recording: Annotated[
        Path | None,
        typer.Argument(help="Recording with detections, embeddings or people; default: live."),
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write.")] = Path("trace.json"),
    seconds: Annotated[float, typer.Option(min=0.1, help="Seconds to listen.")] = 5.0,
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Write the path of frames through all processes, for https://ui.perfetto.dev.

    chrome://tracing opens the file, too. --seconds applies to a live system only.
    """
    traces = FrameTraces()
    if recording:
        for _, message in open_recording(recording).messages(*KINDS):
            traces.add_message(message)
        problem, hint = "is in it", "Record detections, embeddings and people."
    else:
        end_s = time.monotonic() + seconds
        with open_client(connect, robot) as client, suppress(KeyboardInterrupt):
            for message in client.messages(*KINDS, timeout_s=seconds):
                traces.add_message(message)
                if time.monotonic() > end_s:
                    break
        problem, hint = "arrived", "See what runs with people4d ps."
    if not traces.traces:
        raise People4dError(f"no frame with the times of its stages {problem}", hint)
    try:
        out.write_text(json.dumps(traces.chrome()), encoding="utf-8")
    except OSError as error:
        raise People4dError(f"{out} cannot be written: {error.strerror}") from error
    typer.echo(f"{len(traces.traces)} frames in {out}; open it in https://ui.perfetto.dev")
