"""The report: one complete HTML file, and its tables and images as files."""

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from string import Template

import msgspec

from evaluation import protocol
from evaluation.evaluate import Evaluation, ReportFigure
from evaluation.protocol import protocol_of
from evaluation.report import parts
from evaluation.report.csv_files import (
    write_bytes,
    write_runs,
    write_summary,
    write_switches,
    write_table,
)
from evaluation.report.parts import write_parts
from evaluation.report.switch_images import SwitchImage
from evaluation.report.tables import SOURCE, ReportTable, groups_of
from evaluation.run.preparation import EvaluationPlan, warnings_of
from evaluation.run.run import RunScores


def write(plan: EvaluationPlan, evaluation: Evaluation, folder: Path, command: str) -> Path:
    """Write all metrics as CSV files, images and the report.

    SourceError if the folder cannot be written.

    Returns:
        Path of the report, which states the command that regenerates it.
    """
    scores = [run.scores for run in evaluation.runs]
    switches = [image for run in evaluation.runs for image in run.images]
    write_runs(folder / "runs.csv", scores, evaluation.rows)
    write_summary(folder / "summary.csv", groups_of(scores, evaluation.rows))
    write_switches(folder / "switches.csv", evaluation.switches)
    runs = [(r.scores.method, r.scores.recording.name, r.parts) for r in evaluation.runs]
    write_parts(folder / parts.FILE, runs)
    truths = {run.scores.recording.name: run.truth for run in evaluation.runs}
    stated = protocol_of(command, plan.methods, truths)
    write_bytes(folder / protocol.FILE, msgspec.json.format(msgspec.json.encode(stated)))
    for table in evaluation.tables:
        write_table(folder / "tables" / f"{table.name}.csv", table)
    for figure in evaluation.figures:
        write_bytes(folder / "figures" / f"{figure.name}.png", figure.png)
    for number, switch in enumerate(switches, 1):
        name = f"{number:03d}_{switch.method}_{switch.recording}.png"
        write_bytes(folder / "switches" / name, switch.png)
    page = Template(Path(__file__).with_name("page.html").read_text(encoding="utf-8"))
    html = page.substitute(
        methods=escape(", ".join(dict.fromkeys(result.method for result in scores))),
        command=escape(command),
        warnings="\n".join(f'<p class="warning">{escape(one)}</p>' for one in warnings_of(plan)),
        source=SOURCE,
        tables="\n".join(map(_report_table, evaluation.tables)),
        figures="\n".join(map(_figure, evaluation.figures)) or "<p>None were drawn.</p>",
        shown=len(switches),
        switches=len(evaluation.switches),
        images="\n".join(map(_switch, switches)),
        recordings=_recordings(scores),
        settings="\n".join(
            f"<details><summary>{escape(method.name)}</summary>"
            f"<pre>{escape(method.text())}</pre></details>"
            for method in plan.methods
        ),
    )
    report = folder / "report.html"
    write_bytes(report, html.encode())
    return report


def _report_table(table: ReportTable) -> str:
    head = ("method", "people", *(column.title for column in table.columns))
    rows: list[tuple[str, Sequence[str]]] = []
    for line in table.rows:
        if line.published and "published" not in (kind for kind, _ in rows):
            rows.append(("label", [SOURCE]))
        kind = "published" if line.published else "all" if line.people == "all" else ""
        rows.append((kind, [line.method, line.people, *line.cells]))
    title = f'<h3 id="{table.name}">{escape(table.title)}</h3>'
    return f'{title}\n<div class="wide">{_table(head, rows)}</div>'


def _recordings(scores: Sequence[RunScores]) -> str:
    first: dict[str, RunScores] = {}
    for result in scores:
        first.setdefault(result.recording.name, result)
    rows = []
    for name, result in first.items():
        visibility = "known" if result.has_visibility else "unknown: none counts as occluded"
        duration_s = f"{result.scores.lifetimes.duration_s:.1f}"
        rows.append(("", [name, str(result.people), duration_s, str(result.frames), visibility]))
    return _table(("recording", "people", "seconds", "frames", "visible share"), rows)


def _table(head: Sequence[str], rows: Iterable[tuple[str, Sequence[str]]]) -> str:
    """Return a table from class and cells of each row; a single cell fills its row."""
    lines = []
    for kind, cells in rows:
        span = f' colspan="{len(head)}"' if len(cells) == 1 else ""
        texts = "".join(f"<td{span}>{escape(text)}</td>" for text in cells)
        lines.append(f'<tr class="{kind}">{texts}</tr>')
    titles = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "\n".join(lines)
    return f"<table><thead><tr>{titles}</tr></thead><tbody>\n{body}\n</tbody></table>"


def _figure(figure: ReportFigure) -> str:
    title = escape(figure.title)
    return f"<h3>{title}</h3>\n{_image(title, figure.png)}"


def _switch(switch: SwitchImage) -> str:
    title, sentence = f"{switch.method} on {switch.recording}", escape(switch.sentence)
    return f"<h3>{escape(title)}</h3>\n<p>{sentence}</p>\n{_image(sentence, switch.png)}"


def _image(title: str, png: bytes) -> str:
    return f'<img alt="{title}" src="data:image/png;base64,{base64.b64encode(png).decode()}">'
