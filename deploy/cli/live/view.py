"""Command `people4d view`."""

import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from itertools import count
from pathlib import Path
from typing import Annotated, Protocol

import typer

from common.extras import need
from common.io.recording import open_recording
from deploy import viewers
from deploy.cli.data.replay import paced
from deploy.cli.data.spans import End, RecordingSpan, Start
from deploy.cli.options import Connect, Robot, open_client
from deploy.cli.terminal import signals_interrupt
from deploy.viewers.scene import PeopleScene
from people4d.client import Client
from people4d.errors import ConfigError
from people4d.messages import CompressedRgbdFrame, Health, Message, Predictions, RgbdFrame

FRAMES: tuple[type[Message], ...] = (RgbdFrame, CompressedRgbdFrame)
INPUTS: tuple[type[Message], ...] = (*PeopleScene.inputs, Predictions, Health)
LAYOUT = Path(viewers.__file__).with_name("people4d_layout.json")
RRD = ".rrd"
PORT = 8765  # default port of Foxglove's app


class ViewerOutput(Protocol):
    """Destination of viewed messages."""

    def write(self, message: Message, log_time_ns: int) -> None:
        """Write a message with its time of arrival."""
        ...

    def close(self) -> None:
        """Finish the output."""
        ...


def view(
    recording: Annotated[
        Path | None, typer.Argument(help="A people4d recording; default: the running system.")
    ] = None,
    file: Annotated[
        Path | None, typer.Argument(help="File to write: out.rrd, or out.mcap for Foxglove.")
    ] = None,
    rerun: Annotated[bool, typer.Option("--rerun", help="Show in Rerun's viewer.")] = False,
    foxglove: Annotated[
        bool, typer.Option("--foxglove", help="Serve Foxglove's app by its WebSocket protocol.")
    ] = False,
    image_hz: Annotated[
        float, typer.Option("--image-rate", min=0.0, help="Maximum live image rate [Hz]; 0: none.")
    ] = 10.0,
    address: Annotated[str, typer.Option(help="Address of the server for Foxglove.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Its port; 0: a free one.")] = PORT,
    rate: Annotated[float, typer.Option(min=0.01, help="Multiple of the recorded rate.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Repeat the recording.")] = False,
    start_s: Start = 0.0,
    end_s: End = None,
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Show people, images and transforms in Rerun or Foxglove, or write a file for them.

    Rerun needs the extra rerun, Foxglove the extra foxglove.
    """
    if rerun == foxglove:
        raise ConfigError("expected one viewer", "Add --rerun or --foxglove.")
    need("Rerun", "rerun") if rerun else need("Foxglove", "foxglove")
    if recording and recording.suffix == RRD and file is None:
        recording, file = None, recording
    if file is not None and rerun != (file.suffix == RRD):
        raise ConfigError(
            f"{file} has an unsupported format", f"Rerun writes *{RRD}, Foxglove *.mcap."
        )
    span = RecordingSpan(start_s, end_s)
    with ExitStack() as stack, suppress(KeyboardInterrupt), signals_interrupt():
        if recording:
            messages = recorded(recording, span, None if file else rate, loop and file is None)
        else:
            client = stack.enter_context(open_client(connect, robot))
            messages = live(client, image_hz)
        output = (
            rerun_output(robot, file)
            if rerun
            else foxglove_output(image_hz > 0, file, address, port)
        )
        stack.enter_context(closing(output))
        for log_time_ns, message in messages:
            output.write(message, log_time_ns)
        if foxglove and file is None:
            typer.echo("The recording ended; Ctrl-C ends the server.")
            signal.pause()
    if file:
        typer.echo(f"Wrote {file}.")


def recorded(
    path: Path, span: RecordingSpan, rate: float | None, loop: bool
) -> Iterator[tuple[int, Message]]:
    """Return messages of a recording with their log times [ns], paced if there is a rate."""
    recording = open_recording(path)
    span.check(recording)  # checked before the output is opened

    def passes() -> Iterator[tuple[int, Message]]:
        for _ in count() if loop else range(1):
            timed = span.messages(recording)
            yield from timed if rate is None else paced(timed, rate)

    return passes()


def live(client: Client, image_hz: float) -> Iterator[tuple[int, Message]]:
    """Yield messages of a running system with the times of their arrival [ns]."""
    limit = ImageRate(image_hz)
    inputs = tuple(kind for kind in INPUTS if image_hz or kind not in FRAMES)
    for message in client.messages(*inputs):
        now_ns = time.time_ns()
        if limit.passes(message, now_ns):
            yield now_ns, message


def rerun_output(robot: str, file: Path | None) -> ViewerOutput:
    """Open Rerun's viewer, or a file for it."""
    from deploy.viewers.rerun_log import open_log  # noqa: PLC0415 (optional)

    return open_log(robot, file)


def foxglove_output(images: bool, file: Path | None, address: str, port: int) -> ViewerOutput:
    """Open a server for Foxglove's app, or a file for it."""
    from deploy.viewers.foxglove_messages import FoxgloveConverter  # noqa: PLC0415 (optional)
    from deploy.viewers.foxglove_outputs import FoxgloveFile, FoxgloveServer  # noqa: PLC0415

    converter = FoxgloveConverter(images)
    if file:
        return FoxgloveFile(converter, file)
    server = FoxgloveServer(converter, address, port)
    typer.echo(
        f"Foxglove's app: open a connection to ws://{address}:{server.port}; Ctrl-C ends it."
    )
    typer.echo(f"Layout to import: {LAYOUT}")
    return server


class ImageRate:
    """Limits the rate of the frames of each camera; other messages pass.

    Compressed frames of a camera with uncompressed frames do not pass.
    """

    def __init__(self, rate_hz: float) -> None:
        self._interval_ns = round(1e9 / rate_hz) if rate_hz else 0
        self._last_ns: dict[str, int] = {}
        self._uncompressed: set[str] = set()

    def passes(self, message: Message, now_ns: int) -> bool:
        """Check that a message passes at this time."""
        if not isinstance(message, RgbdFrame | CompressedRgbdFrame):
            return True
        if isinstance(message, RgbdFrame):
            self._uncompressed.add(message.camera)
        elif message.camera in self._uncompressed:
            return False
        if now_ns - self._last_ns.get(message.camera, 0) < self._interval_ns:
            return False
        self._last_ns[message.camera] = now_ns
        return True
