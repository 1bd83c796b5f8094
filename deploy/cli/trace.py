"""people4d trace."""

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
        typer.Argument(help="Recording with detections, embeddings or people; else live."),
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="The file.")] = Path("trace.json"),
    seconds: Annotated[float, typer.Option(min=0.1, help="How long to listen.")] = 5.0,
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Write the way of frames through all processes, for https://ui.perfetto.dev.

    Chrome's own chrome://tracing opens it, too. --seconds counts for a live system only.
    """
    traces = FrameTraces()
    if recording:
        for _, message in open_recording(recording).messages(*KINDS):
            traces.add(message)
    else:
        _listen(traces, seconds, robot, connect)
    if not traces.traces:
        raise People4dError(
            f"no frame with the times of its stages {'is in it' if recording else 'came'}",
            "Record detections, embeddings and people."
            if recording
            else "See what runs with people4d ps.",
        )
    try:
        out.write_text(json.dumps(traces.chrome()), encoding="utf-8")
    except OSError as error:
        raise People4dError(f"{out} cannot be written: {error.strerror}") from error
    typer.echo(f"{len(traces.traces)} frames in {out}; open it in https://ui.perfetto.dev")


def _listen(traces: FrameTraces, seconds: float, robot: str, connect: str) -> None:
    end_s = time.monotonic() + seconds
    with open_client(connect, robot) as client, suppress(KeyboardInterrupt):
        for arrival in client.arrivals(*KINDS, timeout_s=seconds):
            traces.add(arrival.message)
            if time.monotonic() > end_s:
                break
