"""The page of one person's gait: one HTML file that holds everything it shows."""

import importlib.metadata
from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template

from common.drawing.strokes import colour_of
from common.drawing.topdown import Trajectories
from evaluation.gait.literature import REFERENCES
from evaluation.gait.parameters import GaitParameter, limping_side
from services.gait.steps.steps import FootStep
from services.gait.steps.swings import FEET
from services.report.page import page_style
from services.report.svg import Line, draw_map, plot

NOTE = (
    "The measures are for comparing people with themselves. They are not intended for medical use."
)
HEAD = ("", "unit", "mean", "95 % interval", "values", "definition", "literature")


def person_page(
    person: int, parameters: Sequence[GaitParameter], steps: Sequence[FootStep], path: Trajectories
) -> str:
    """Return the page of a person."""
    template = Path(__file__).with_name("person_page.html").read_text(encoding="utf-8")
    side = limping_side(parameters)
    limp = f" It spares the {side} foot." if side else ""
    return Template(template).substitute(
        style=page_style(),
        title=f"Gait of person {person}",
        headline=escape(f"{len(steps)} steps.{limp}" if steps else "No steps were found."),
        note=escape(NOTE),
        table=_table(parameters),
        references=_references(),
        plots=_plots(steps),
        map=draw_map(path, {person: colour_of(person)}),
        version=escape(importlib.metadata.version("people4d")),
    )


def _plots(steps: Sequence[FootStep]) -> str:
    styles = dict(zip(FEET, ("two", "one"), strict=True))
    lengths = [
        Line(f"{foot} foot", [(s.landed_s, s.length_m) for s in steps if s.foot == foot], style)
        for foot, style in styles.items()
    ]
    times = [
        Line(
            f"{foot} foot",
            [
                (s.landed_s, s.stride.step_time_s)
                for s in steps
                if s.foot == foot and s.stride and s.stride.step_time_s
            ],
            style,
        )
        for foot, style in styles.items()
    ]
    confidence = [Line("confidence", [(s.landed_s, s.confidence) for s in steps], "one", dots=True)]
    drawn = plot(_positive(lengths), "m", "Length of each step")
    drawn += plot(times, "s", "Time of each step")
    return drawn + plot(confidence, "1", "Confidence of each step")


def _positive(lines: Sequence[Line]) -> list[Line]:
    return [Line(one.name, [(x, max(y, 0.0)) for x, y in one.points], one.style) for one in lines]


def _table(parameters: Sequence[GaitParameter]) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in HEAD)
    rows = []
    for one in parameters:
        interval = "" if one.low is None or one.high is None else f"{one.low:.3g} to {one.high:.3g}"
        value = "" if one.value is None else f"{one.value:.3g}"
        cells = (one.name, one.unit, value, interval, str(one.count))
        row = "".join(f"<td>{escape(cell)}</td>" for cell in cells)
        text = "".join(f'<td class="text">{escape(t)}</td>' for t in (one.definition, one.source))
        rows.append(f"<tr>{row}{text}</tr>")
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _references() -> str:
    """Return the literature of the definitions as a list."""
    items = (f"<li>[{escape(key)}] {escape(text)}</li>" for key, text in REFERENCES.items())
    return f"<ul>{''.join(items)}</ul>"
