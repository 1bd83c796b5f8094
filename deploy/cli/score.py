"""people4d score."""

import math
from contextlib import suppress

import numpy as np
from rich.console import Group
from rich.table import Table
from rich.text import Text

from deploy.cli.live import Json, Once, Timeout, follow
from deploy.cli.options import Connect, Robot, open_client
from people4d.errors import People4dError
from people4d.messages import Alignment, PersonScore, Score, Tally

VIEWS = {"inside": "", "outside": "[dim]outside[/]", "unknown": "[yellow]unknown[/]"}
NO_VIEW = "pose or calibration of the camera is unknown: all people count, also out of view"


def score(
    once: Once = False,
    json: Json = False,
    timeout_s: Timeout = None,
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Score tracks against the truth, live; needs a system with --truth."""
    with open_client(connect, robot) as client, suppress(KeyboardInterrupt):
        messages = client.messages(Score, timeout_s=timeout_s)
        waiting = "waiting for a score ..."
        if not follow(messages, render_score, once=once, json=json, waiting=waiting):
            raise People4dError(
                f"no score came within {timeout_s:g} s",
                "It needs people and truth (people4d up --truth FILE); see people4d ps.",
            )


def render_score(message: Score) -> Group:
    """Render one message: all people now, then the last seconds and all frames."""
    notes = [Text("") if message.alignment is None else _alignment(message.alignment)]
    if any(person.view == "unknown" for person in message.people):
        notes.append(Text(NO_VIEW, style="yellow"))
    return Group(_people(message), Text(""), _figures(message), *notes)


def _people(message: Score) -> Table:
    title = f"{len(message.people)} people in the truth · frame of {message.camera}"
    table = Table(title=title, title_justify="left", box=None, header_style="bold")
    table.add_column("person")
    table.add_column("view", min_width=7)
    for column in ("track", "off m", "off m/s", "off °", "same id"):
        table.add_column(column, justify="right", min_width=6)
    for person in sorted(message.people, key=lambda person: person.id):
        table.add_row(person.id, VIEWS[person.view], *_row(person))
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
    table = Table(box=None, header_style="bold")
    table.add_column("", min_width=20)
    for name in ("last 10 s", "in all"):
        table.add_column(name, justify="right", min_width=14)
    recent, total = _column(message.recent), _column(message.total)
    for name, figure in recent.items():
        table.add_row(name, figure, total[name])
    return table


def _column(tally: Tally) -> dict[str, str]:
    yaw = tally.yaw_rmse_rad
    return {
        "position rmse": f"{_number(tally.position_rmse_m)} m",
        "velocity rmse": f"{_number(tally.velocity_rmse_mps)} m/s",
        "yaw rmse": f"{_number(None if yaw is None else math.degrees(yaw), 1)} °",
        "matched": _share(tally.matched, tally.truths),
        "predicted of these": _share(tally.predicted, tally.matched),
        "false alarms": str(tally.false_alarms),
        "people out of view": str(tally.outside),
        "id switches": str(tally.id_switches),
        "a minute": _per_minute(tally),
        "frames": str(tally.frames),
    }


def _share(part: int, total: int) -> str:
    return f"{100 * part / total:.1f} %" if total else "-"


def _per_minute(tally: Tally) -> str:
    return f"{60 * tally.id_switches / tally.duration_s:.1f}" if tally.duration_s else "-"


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
