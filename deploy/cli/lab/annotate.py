"""Command `people4d annotate`."""

import os
import threading
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from common.extras import need
from deploy.cli.options import Settings
from deploy.cli.terminal import console, plain_table, print_table, signals_interrupt
from people4d.errors import ConfigError

# Most modules are imported on use: compiled code takes a second to load.

if TYPE_CHECKING:
    from services.camera.config import CameraConfig


def annotate(
    recording: Annotated[Path, typer.Argument(help="Recording, ROS bag or folder.")],
    out: Annotated[
        Path | None, typer.Option(help="File of annotations; default: RECORDING.annotations.json.")
    ] = None,
    every: Annotated[int, typer.Option(min=1, help="Annotate every n-th image.")] = 1,
    compare: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Compare with another annotator's file, and exit."),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the page.")] = 7480,
    set_: Settings = [],  # noqa: B006 (typer copies it)
) -> None:
    """Mark people in a recording in the browser, for people4d evaluate --truth.

    Every change is saved at once; the same command continues.
    """
    from evaluation.methods import read_method  # noqa: PLC0415

    need("people4d annotate", "dashboard")
    # A recording may be the current folder
    out = out or Path(f"{os.path.abspath(recording)}.annotations.json")
    camera = read_method("best", set_).camera
    camera = msgspec.structs.replace(camera, source=str(recording))
    if compare:
        _show_agreement(camera, out, compare)
    else:
        _serve(camera, out, every, port)


def _serve(camera: "CameraConfig", out: Path, every: int, port: int) -> None:
    from evaluation.annotations.images import read_images  # noqa: PLC0415
    from evaluation.annotations.web import AnnotationApp  # noqa: PLC0415
    from services.dashboard.config import DashboardConfig  # noqa: PLC0415
    from services.dashboard.server import WebServer  # noqa: PLC0415

    if not os.access(out if out.exists() else out.absolute().parent, os.W_OK):
        raise ConfigError(f"{out} cannot be written", "Name a file elsewhere: --out FILE.")
    with suppress(KeyboardInterrupt), signals_interrupt():
        with console.status("Reading images ...") as status:
            images = read_images(camera, every, lambda n: status.update(f"Reading image {n} ..."))
        app, config = (
            AnnotationApp(Path(camera.source).name, images, out),
            DashboardConfig(port=port),
        )
        server = WebServer(config, lambda tokens: app.guarded(config, tokens))
        try:
            typer.echo(f"Annotate at {server.address.url} Marks are saved in {out}; Ctrl-C ends.")
            threading.Event().wait()
        finally:
            server.close()


def _show_agreement(camera: "CameraConfig", first: Path, second: Path) -> None:
    from evaluation.annotations.agreement import agreement  # noqa: PLC0415

    table = plain_table("agreement", ">value", ">n")
    for row in agreement(camera, first, second).rows():
        table.add_row(*row)
    print_table(table)
