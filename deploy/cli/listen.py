"""people4d listen."""

import math
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Annotated, Any

import msgspec
import typer
from rich.console import Console
from rich.live import Live
from rich.table import Table

from common.errors import People4dError
from common.messages import Tracks
from deploy.cli.options import Connect, Robot, open_client

COLOURS = {"confirmed": "green", "lost": "yellow", "tentative": "dim"}
REDRAW_S = 0.1


def listen(
    once: Annotated[bool, typer.Option("--once", help="Show one message and end.")] = False,
    json: Annotated[bool, typer.Option("--json", help="One JSON line for each message.")] = False,
    timeout_s: Annotated[
        float | None,
        typer.Option("--timeout", help="End after so many seconds without a message."),
    ] = None,
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Show the people around the robot, live."""
    with open_client(connect, robot) as client, suppress(KeyboardInterrupt):
        messages = client.messages(Tracks, timeout_s=timeout_s)
        shown = _print_json(messages, once) if json else _show(messages, once)
        if not shown:
            raise People4dError(
                f"no people message came within {timeout_s:g} s",
                "See what runs with people4d ps.",
            )


def _print_json(messages: Iterator[Tracks], once: bool) -> bool:
    tracks = None
    for tracks in messages:
        typer.echo(msgspec.json.encode(tracks, enc_hook=lambda array: array.tolist()).decode())
        if once:
            break
    return tracks is not None


def _show(messages: Iterator[Tracks], once: bool) -> bool:
    console = Console()
    tracks = None
    if once:
        for tracks in messages:
            console.print(table_of(tracks, time.time_ns()))
            break
        return tracks is not None
    drawn_s = 0.0
    with Live("waiting for people ...", console=console, auto_refresh=False) as live:
        for tracks in messages:
            # A terminal that is slower than the camera must not hold up reading.
            if time.monotonic() - drawn_s > REDRAW_S:
                live.update(table_of(tracks, time.time_ns()), refresh=True)
                drawn_s = time.monotonic()
    return tracks is not None


def table_of(tracks: Tracks, now_ns: int) -> Table:
    """Draw one message.

    Args:
        tracks: The message.
        now_ns: Wall clock, for the latency.
    """
    table = Table(title=_title(tracks, now_ns), title_justify="left", box=None, header_style="bold")
    table.add_column("id", justify="right")
    table.add_column("state", min_width=9)
    for column in ("x m", "y m", "z m", "m/s", "yaw °", "score", "unseen", "frames"):
        table.add_column(column, justify="right", min_width=5)
    for person in sorted(tracks.people, key=lambda track: track.id):
        colour = COLOURS[person.state]
        unseen_s = person.time_since_update_s
        table.add_row(
            str(person.id),
            f"[{colour}]{person.state}[/]",
            *(f"{value:.2f}" for value in person.position_m),
            f"{math.hypot(*person.velocity_mps):.2f}",
            "-" if person.yaw_rad is None else f"{math.degrees(person.yaw_rad):.0f}",
            f"{person.score:.2f}",
            f"{unseen_s:.1f} s" if unseen_s else "",
            str(person.age),
        )
    return table


def latency_ms(tracks: Tracks, now_ns: int) -> float | None:
    """Return the time since the first traced stage [ms]; None for an untraced message."""
    return (now_ns - tracks.trace[0].start_ns) / 1e6 if tracks.trace else None


def _title(tracks: Tracks, now_ns: int) -> str:
    latency = latency_ms(tracks, now_ns)
    parts: list[Any] = [
        f"{len(tracks.people)} people in {tracks.frame_id}",
        f"frame {tracks.sequence} of {tracks.camera}",
        tracks.tracker,
    ]
    return " · ".join(parts + ([f"{latency:.0f} ms old"] if latency else []))
