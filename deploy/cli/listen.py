"""people4d listen."""

import math
import time
from contextlib import suppress
from typing import Any

from rich.table import Table

from deploy.cli.live import Json, Once, Timeout, follow
from deploy.cli.options import Connect, Robot, open_client
from people4d.errors import People4dError
from people4d.messages import Tracks

COLOURS = {"confirmed": "green", "lost": "yellow", "tentative": "dim"}


def listen(
    once: Once = False,
    json: Json = False,
    timeout_s: Timeout = None,
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Show the people around the robot, live."""
    with open_client(connect, robot) as client, suppress(KeyboardInterrupt):
        messages = client.messages(Tracks, timeout_s=timeout_s)
        waiting = "waiting for people ..."
        if not follow(messages, table_now, once=once, json=json, waiting=waiting):
            raise People4dError(
                f"no people message came within {timeout_s:g} s",
                "See what runs with people4d ps.",
            )


def table_now(tracks: Tracks) -> Table:
    """Return people as a table, with their age at this moment."""
    return table_of(tracks, time.time_ns())


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
    for person in sorted(tracks.tracks, key=lambda track: track.id):
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
        f"{len(tracks.tracks)} people in {tracks.frame_id}",
        f"frame {tracks.sequence} of {tracks.camera}",
        tracks.tracker,
    ]
    return " · ".join(parts + ([f"{latency:.0f} ms old"] if latency else []))
