"""The page of one person's gait: one self-contained HTML file."""

import importlib.metadata
from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template

from common.drawing.topdown import Trajectories
from evaluation.gait.parameters import GaitParameter, limping_side, recognisable_limp
from services.gait.steps.steps import FEET, FootStep
from services.report.page import map_figure, page_style
from services.report.svg import Line, plot

NOTE = (
    "The measures are for comparing people with themselves. They are not intended for medical use."
)
HEAD = ("", "unit", "mean", "95 % interval", "values", "definition")
SUMMARY = (("step length", 2, "m a step"), ("cadence", 0, "steps a minute"), ("speed", 2, "m/s"))


def person_page(
    person: int, parameters: Sequence[GaitParameter], steps: Sequence[FootStep], path: Trajectories
) -> str:
    """Return the page of a person."""
    template = Path(__file__).with_name("person_page.html").read_text(encoding="utf-8")
    return Template(template).substitute(
        style=page_style(),
        title=f"Gait of person {person}",
        headline=escape(_headline(parameters, steps)),
        note=escape(NOTE),
        table=_table(parameters),
        plots=_plots(steps),
        map=map_figure(path),
        version=escape(importlib.metadata.version("people4d")),
    )


def _headline(parameters: Sequence[GaitParameter], steps: Sequence[FootStep]) -> str:
    """Summarise a walk in two sentences: its means, and whether the person limps."""
    if not steps:
        return "No steps were found."
    known = {one.name: one.value for one in parameters if one.value is not None}
    texts = [f"{len(steps)} steps in {steps[-1].landed_s - steps[0].landed_s:.0f} s"]
    texts += [f"{known[name]:.{digits}f} {unit}" for name, digits, unit in SUMMARY if name in known]
    side, least = limping_side(parameters), recognisable_limp(parameters)
    if side:
        limp = f"The {side} foot is spared."
    elif least is None:
        limp = "There are too few steps for a limp to show."
    else:
        limp = f"No limp is seen; below {least:.0f} % it would not show in so many steps."
    return f"{', '.join(texts)}. {limp}"


def _plots(steps: Sequence[FootStep]) -> str:
    """Return plots of all steps since the first one.

    Dots are not joined, since a person may stand between them.
    """
    if not steps:
        return ""
    begin_s, end_s = steps[0].landed_s, steps[-1].landed_s
    lengths, times, confidences = [], [], []
    for foot, style in zip(FEET, ("two", "one"), strict=True):
        own, name = [(s.landed_s - begin_s, s) for s in steps if s.foot == foot], f"{foot} foot"
        length = [(since_s, max(s.length_m, 0.0)) for since_s, s in own]
        time = [(x, t) for x, s in own if s.stride and (t := s.stride.step_time_s)]
        confidence = [(since_s, 100 * s.confidence) for since_s, s in own]
        lengths.append(Line(name, length, style, dots=True))
        times.append(Line(name, time, style, dots=True))
        confidences.append(Line(name, confidence, style, dots=True))
    figures = (
        (lengths, "m", "Length of each step"),
        (times, "s", "Time of each step"),
        (confidences, "%", "Confidence of each step"),
    )
    return "".join(plot(*one, end_s=end_s - begin_s) for one in figures)


def _table(parameters: Sequence[GaitParameter]) -> str:
    head = "".join(f"<th>{cell}</th>" for cell in HEAD)
    rows = []
    for one in parameters:
        interval = "" if one.low is None or one.high is None else f"{one.low:.3g} to {one.high:.3g}"
        value = "" if one.value is None else f"{one.value:.3g}"
        cells = (one.name, one.unit, value, interval, str(one.count))
        row = "".join(f"<td>{escape(cell)}</td>" for cell in cells)
        rows.append(f'<tr>{row}<td class="text wide">{escape(one.definition)}</td></tr>')
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
