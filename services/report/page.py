"""The page of a run: one complete HTML file."""

import base64
import importlib.metadata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from string import Template

import cv2

from common.drawing.topdown import Trajectories, draw_map
from services.report.series import RunSeries
from services.report.statistics import END_TO_END, RunSummary
from services.report.svg import Bar, Line, bars, plot
from services.report.text import (
    facts,
    headline,
    latency_of,
    latency_table,
    multiple_of_inference,
    slowest_stage,
)

MAP_PX = 560  # [px] side of the map
VIDEO_MAX = 24 * 2**20  # [bytes] maximum size of an embedded video; others are separate files


@dataclass(frozen=True)
class RunPage:
    """Contents of the page."""

    summary: RunSummary
    trajectories: Trajectories
    series: RunSeries
    note: str = ""  # sentence about simulated data; empty: none
    videos: Mapping[str, Path] = field(default_factory=dict)  # video by camera
    sheet_jpeg: bytes = b""  # frames in a grid; empty: none

    def html(self) -> str:
        """Return the page."""
        template = Path(__file__).with_name("page.html").read_text(encoding="utf-8")
        note = f'<section class="note"><p>{escape(self.note)}</p></section>' if self.note else ""
        return Template(template).substitute(
            style=page_style(),
            title="Report of a run",
            headline=escape(headline(self.summary)),
            note=note + _limits(self.summary),
            figures="".join(_figures(self.summary)),
            videos="".join(_video(name, path) for name, path in self.videos.items()),
            map=map_figure(self.trajectories) or "<p>No person was tracked.</p>",
            plots=self._plots() or "<p>No frame was tracked.</p>",
            latency=self._latency() or "<p>Nothing was measured.</p>",
            table=_table(latency_table(self.summary)),
            facts=_facts(self.summary),
            sheet=self._sheet(),
            version=escape(importlib.metadata.version("people4d")),
        )

    def _plots(self) -> str:
        frames = self.series.frames
        people = [
            Line("detected", [(f.time_s, f.detections) for f in frames], "two", steps=True),
            Line("tracked", [(f.time_s, f.tracks) for f in frames], "one", steps=True),
        ]
        errors = [(e.time_s, e.error_m) for e in self.series.errors]
        latency = [(f.time_s, f.latency_ms) for f in frames if f.latency_ms is not None]
        plots = plot(people, "people", "People in a frame")
        if errors:
            line = Line("one person in one frame", errors, "one", dots=True)
            plots += plot([line], "m", "Error of the position against the ground truth")
        if latency:
            plots += plot([Line("end to end", latency, "one")], "ms", "Latency")
        return plots

    def _latency(self) -> str:
        stages = [
            Bar(name, p.p50_ms, p.p95_ms, p.p99_ms)
            for name, p in self.summary.latency.items()
            if name != END_TO_END and p.p99_ms >= 0.05
        ]
        return bars(stages, "ms", "Duration of each stage")

    def _sheet(self) -> str:
        if not self.sheet_jpeg:
            return ""
        image = _data("image/jpeg", self.sheet_jpeg)
        shown = f'<img alt="Annotated frames" src="{image}">'
        return f"<section><h2>Frames of the run</h2>{shown}</section>"


def page_style() -> str:
    """Return the style sheet of pages with plots, light and dark."""
    return Path(__file__).with_name("page.css").read_text(encoding="utf-8")


def map_figure(trajectories: Trajectories) -> str:
    """Return the map as a picture in a figure; empty if there is no content."""
    if not (trajectories.tracks or trajectories.truth or trajectories.cameras):
        return ""
    image = cv2.cvtColor(draw_map(trajectories, MAP_PX, MAP_PX), cv2.COLOR_RGB2BGR)
    source = _data("image/png", cv2.imencode(".png", image)[1].tobytes())
    return f'<figure><img alt="Map of the trajectories" src="{source}"></figure>'


def _figures(summary: RunSummary) -> Iterator[str]:
    score, total = summary.score, latency_of(summary)
    yield _figure("frames tracked", str(summary.frames_tracked), f"of {summary.frames}")
    yield _figure("identities", str(summary.tracks), "")
    if score is not None:
        if score.position_rmse_m is not None:
            yield _figure("position error", f"{100 * score.position_rmse_m:.1f}", "cm RMSE")
        yield _figure("people found", f"{_percent(score.matched, score.truths)}", "of the truth")
        yield _figure("ID switches", str(score.id_switches), "")
    if total is not None:
        multiple = multiple_of_inference(summary)
        words = f", {multiple:.1f} x inference" if multiple else ""
        yield _figure("latency", f"{total.p50_ms:.0f}", f"ms, p99 {total.p99_ms:.0f}{words}")
    if summary.processed_hz:
        yield _figure("speed", f"{summary.processed_hz:.1f}", "frames a second")
    if slowest := slowest_stage(summary):
        stage = slowest[0].replace(".", " ")
        yield _figure("possible speed", f"{slowest[1]:.1f}", f"limited by {stage}")


def _limits(summary: RunSummary) -> str:
    items = "".join(f"<li>{escape(reason)}</li>" for reason in summary.degraded)
    return (
        f'<section class="note"><p>This run had limits:</p><ul>{items}</ul></section>'
        if items
        else ""
    )


def _figure(name: str, value: str, unit: str) -> str:
    return (
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)} <small>{escape(unit)}</small></dd></div>"
    )


def _percent(part: int, total: int) -> str:
    return f"{100 * part / total:.0f} %" if total else "-"


def _video(camera: str, path: Path) -> str:
    try:
        data = path.read_bytes() if path.stat().st_size <= VIDEO_MAX else b""
    except OSError:
        return ""
    source = _data("video/webm", data) if data else escape(path.name)
    return (
        f"<section><h2>Camera {escape(camera)}</h2>"
        f'<video controls muted loop playsinline preload="metadata" src="{source}"></video>'
        "</section>"
    )


def _data(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def _table(rows: Sequence[Sequence[str]]) -> str:
    if not rows:
        return ""
    head = "".join(f"<th>{escape(cell)}</th>" for cell in rows[0])
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows[1:]
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _facts(summary: RunSummary) -> str:
    rows = "".join(
        f'<tr><td>{escape(name)}</td><td class="text">{escape(sentence)}</td></tr>'
        for name, sentence in facts(summary)
    )
    return f"<table><tbody>{rows}</tbody></table>"
