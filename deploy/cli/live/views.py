"""Commands `people4d listen` and `people4d score`."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TypeVar

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from common.transport.stream_clock import LATE_MAX_NS
from deploy.cli.options import Connect, Json, Once, Robot, Timeout, open_client
from deploy.cli.terminal import plain_table, print_json, shown
from people4d.errors import People4dError
from people4d.messages import Alignment, Message, PersonScore, Score, Tally, Tracks

M = TypeVar("M", bound=Message)

REDRAW_S = 0.1
COLOURS = {"confirmed": "green", "lost": "yellow", "tentative": "dim"}
VIEWS = {"inside": "", "outside": "[dim]outside[/]", "unknown": "[yellow]unknown[/]"}
NO_VIEW = "pose or calibration of the camera is unknown: all people count, also out of view"


def listen(
    once: Once = False,
    json: Json = False,
    timeout_s: Timeout = None,
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Show the tracks, live."""
    with open_client(connect, robot) as client:
        messages = client.messages(Tracks, timeout_s=timeout_s)
        if not _show(messages, lambda tracks: table_of(tracks, time.time_ns()), once, json):
            raise People4dError(
                f"no people message arrived within {timeout_s:g} s", f"{client.found()}."
            )


def score(
    once: Once = False,
    json: Json = False,
    timeout_s: Timeout = None,
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Show the errors of tracks against the ground truth, live; needs a system with --truth."""
    with open_client(connect, robot) as client:
        messages = client.messages(Score, timeout_s=timeout_s)
        if not _show(messages, render_score, once, json):
            raise People4dError(
                f"no score arrived within {timeout_s:g} s",
                "It needs people and truth (people4d up --truth FILE); see people4d ps.",
            )


def _show(
    messages: Iterator[M], draw: Callable[[M], RenderableType], once: bool, json: bool
) -> bool:
    """Show messages until Ctrl-C; return False if none arrived before the timeout."""
    message, drawn_s, console = None, 0.0, Console()
    with suppress(KeyboardInterrupt):
        if once or json or not console.is_terminal:
            for message in messages:
                print_json(message) if json else console.print(draw(message))
                if once:
                    break
            return message is not None
        with Live("waiting ...", console=console, auto_refresh=False) as live:
            for message in messages:
                # A slow terminal must not delay reading.
                if time.monotonic() - drawn_s > REDRAW_S:
                    live.update(draw(message), refresh=True)
                    drawn_s = time.monotonic()
            if message is not None:
                live.update(draw(message), refresh=True)
        return message is not None
    return True


def table_of(tracks: Tracks, now_ns: int) -> Table:
    """Draw a message as a table; `now_ns` is the wall clock, for the latency."""
    parts = [
        f"{len(tracks.tracks)} people in {tracks.frame_id}",
        f"frame {tracks.sequence} of {tracks.camera}",
        tracks.tracker,
    ]
    latency = latency_ms(tracks, now_ns)
    if latency:
        parts.append(f"{latency:.0f} ms old")
    numbers = (">x m", ">y m", ">z m", ">m/s", ">yaw °", ">score", ">unseen", ">frames")
    table = plain_table(">id", "state", *numbers, title=shown(" · ".join(parts)), min_width=5)
    for person in sorted(tracks.tracks, key=lambda track: track.id):
        colour = COLOURS[person.state]
        unseen_s = person.time_since_update_s
        table.add_row(
            str(person.id),
            f"[{colour}]{person.state:<9}[/]",
            *(f"{value:.2f}" for value in person.position_m),
            f"{math.hypot(*person.velocity_mps):.2f}",
            "-" if person.yaw_rad is None else f"{math.degrees(person.yaw_rad):.0f}",
            f"{person.score:.2f}",
            f"{unseen_s:.1f} s" if unseen_s else "",
            str(person.age),
        )
    return table


def latency_ms(tracks: Tracks, now_ns: int) -> float | None:
    """Return the time since the first traced stage [ms]; None if it is unknown.

    Messages without a trace, and replayed messages with their old trace, have no latency.
    """
    age_ns = now_ns - tracks.trace[0].start_ns if tracks.trace else LATE_MAX_NS
    return age_ns / 1e6 if age_ns < LATE_MAX_NS else None


def render_score(message: Score) -> Group:
    """Render one message: present people, the last seconds, and all frames."""
    notes = [Text("") if message.alignment is None else _alignment(message.alignment)]
    if any(person.view == "unknown" for person in message.people):
        notes.append(Text(NO_VIEW, style="yellow"))
    return Group(_people(message), Text(""), _figures(message), *notes)


def _people(message: Score) -> Table:
    title = f"{len(message.people)} people in the truth · frame of {message.camera}"
    columns = ("person", "view", ">track", ">off m", ">off m/s", ">off °", ">same id")
    table = plain_table(*columns, title=title, min_width=6)
    for person in sorted(message.people, key=lambda person: person.id):
        table.add_row(shown(person.id), VIEWS[person.view], *_row(person))
    for track in message.false_alarms:
        table.add_row("[red]none[/]", "", f"[red]{track}[/]")
    return table


def _row(person: PersonScore) -> tuple[str, ...]:
    track = "[red]none[/]" if person.view != "outside" else ""
    if person.track is not None:
        colour = "red" if person.switched else "yellow" if person.predicted else "green"
        track = f"[{colour}]{person.track}[/]"
    yaw_rad, consistency = person.yaw_error_rad, person.consistency
    return (
        track,
        _length(person.position_error_m),
        _length(person.velocity_error_mps),
        "-" if yaw_rad is None else f"{math.degrees(yaw_rad):+.0f}",
        "-" if consistency is None else f"{100 * consistency:.0f} %",
    )


def _figures(message: Score) -> Table:
    table = plain_table("", ">last 10 s", ">in all", min_width=14)
    recent, total = _column(message.recent), _column(message.total)
    for name, figure in recent.items():
        table.add_row(name, figure, total[name])
    return table


def _column(tally: Tally) -> dict[str, str]:
    yaw, duration_s = tally.yaw_rmse_rad, tally.duration_s
    return {
        "position rmse": f"{_number(tally.position_rmse_m)} m",
        "velocity rmse": f"{_number(tally.velocity_rmse_mps)} m/s",
        "yaw rmse": f"{_number(None if yaw is None else math.degrees(yaw), 1)} °",
        "matched": _percent(tally.matched, tally.truths),
        "predicted of these": _percent(tally.predicted, tally.matched),
        "false alarms": str(tally.false_alarms),
        "people out of view": str(tally.outside),
        "id switches": str(tally.id_switches),
        "a minute": _number(60 * tally.id_switches / duration_s if duration_s else None, 1),
        "frames": str(tally.frames),
    }


def _percent(part: int, total: int) -> str:
    return f"{100 * part / total:.1f} %" if total else "-"


def _alignment(found: Alignment) -> Text:
    parts = ["alignment " + ("applied" if found.applied else "estimated, not applied")]
    if found.clock_offset_s is not None:
        sigma_ms = 1000 * (found.clock_sigma_s or 0.0)
        parts.append(f"clock {1000 * found.clock_offset_s:+.0f} ± {sigma_ms:.0f} ms")
    if found.matrix is not None:
        turn_deg = math.degrees(math.atan2(found.matrix[1, 0], found.matrix[0, 0]))
        x, y, z = found.matrix[:3, 3]
        parts.append(f"shift {x:+.2f} {y:+.2f} {z:+.2f} m, turn {turn_deg:+.1f}°")
        parts.append(f"rmse {_number(found.rmse_before_m)} -> {_number(found.rmse_after_m)} m")
    if len(parts) == 1:
        parts.append("not found yet: people must walk in different directions")
    return Text("\n" + " · ".join(parts))


def _length(vector: np.ndarray[tuple[int, ...], np.dtype[np.float64]] | None) -> str:
    return "-" if vector is None else f"{np.linalg.norm(vector):.2f}"


def _number(value: float | None, digits: int = 3) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
