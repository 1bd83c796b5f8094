"""The report: one HTML file that contains everything."""

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

from evaluation.report.filmstrips import Filmstrip
from evaluation.report.published import SOURCE
from evaluation.report.tables import ReportTable
from evaluation.run.run import RunScores

STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1180px; margin: 2em auto; padding: 0 1em;
  color: #20242a; background: #fafaf8; }
h1 { font-size: 1.6em; } h2 { font-size: 1.25em; margin-top: 2.2em; }
h3 { font-size: 1em; margin: 1.6em 0 .4em; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .4em 0 1em; }
th, td { padding: .22em .7em; text-align: right; border-bottom: 1px solid #e0e2e4; }
th:first-child, td:first-child { text-align: left; }
th { font-weight: 600; vertical-align: bottom; } tr.all td { font-weight: 600; }
tr.published td { color: #6b7078; background: #f1f1ee; font-weight: 400; }
tr.label td { color: #6b7078; background: #f1f1ee; font-style: italic; text-align: left; }
img { max-width: 100%; } .wide { overflow-x: auto; }
.filmstrip { display: flex; gap: 8px; overflow-x: auto; }
.filmstrip figure { margin: 0; flex: 0 0 172px; font-size: 12px; line-height: 1.35; }
.filmstrip img { width: 172px; height: 172px; background: #e0e2e4; display: block; }
.filmstrip b { display: block; margin-top: 3px; }
.blank { width: 172px; height: 172px; background: #e0e2e4; }
nav a { margin-right: 1.2em; } code { background: #eeeeea; padding: .1em .3em; }
pre { background: #eeeeea; padding: .7em; white-space: pre-wrap; overflow-wrap: anywhere; }
.quiet { color: #6b7078; }
"""


@dataclass(frozen=True)
class ReportFigure:
    """A figure of the report."""

    name: str  # name of its file, without the ending
    title: str
    png: bytes  # content of the file


@dataclass(frozen=True)
class ReportContent:
    """Content of the report."""

    command: str  # command that makes it again
    scores: Sequence[RunScores]  # metrics of all runs
    tables: Sequence[ReportTable]  # in order
    figures: Sequence[ReportFigure]  # in order
    filmstrips: Sequence[Filmstrip]  # ID switches that are shown
    switches: int  # number of all ID switches
    settings: dict[str, str]  # settings of each method, as text, by its name


def html_of(content: ReportContent) -> str:
    """Return the report; it needs no other file."""
    methods = dict.fromkeys(result.method for result in content.scores)
    parts = [
        f"<h1>{escape(', '.join(methods))}</h1>",
        f"<pre>{escape(content.command)}</pre>",
        "<nav>"
        + "".join(
            f'<a href="#{name}">{name}</a>'
            for name in ("tables", "figures", "switches", "recordings", "settings")
        )
        + "</nav>",
        '<h2 id="tables">Tables</h2>',
        NOTE,
        *map(_table, content.tables),
        '<h2 id="figures">Figures</h2>',
        *map(_figure, content.figures),
        "" if content.figures else "<p>None were drawn.</p>",
        '<h2 id="switches">ID switches</h2>',
        f"<p>{len(content.filmstrips)} of {content.switches} are shown; all are in "
        "<code>switches.csv</code>. Each image is centred on the true person; the lines below "
        "list the tracks and detections near by, and their distance from the true position.</p>",
        *map(_filmstrip, content.filmstrips),
        '<h2 id="recordings">Recordings</h2>',
        _recordings(content.scores),
        '<h2 id="settings">Settings</h2>',
        *(
            f"<details><summary>{escape(name)}</summary><pre>{escape(text)}</pre></details>"
            for name, text in content.settings.items()
        ),
    ]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        f"<title>people4d evaluation</title><style>{STYLE}</style></head>\n<body>\n"
        + "\n".join(part for part in parts if part)
        + "\n</body></html>\n"
    )


NOTE = (
    "<p>Mean ± standard deviation over recordings, all and by number of people. Errors are of "
    "people in view of whom at least 35 % are visible, by tracks that measure or predict them, at "
    "most 1 m away on the ground; <i>along</i> is the camera's axis on the ground, <i>across</i> "
    f"its left. Grey rows are not measured here: they are published results ({SOURCE}), "
    "whose x axis lies across and whose y axis lies along the view.</p>"
)


def _table(table: ReportTable) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in ("method", "people", *_titles(table)))
    span = len(table.columns) + 2
    body = []
    labelled = False
    for line in table.rows:
        if line.published and not labelled:
            body.append(f'<tr class="label"><td colspan="{span}">{escape(SOURCE)}</td></tr>')
            labelled = True
        kind = "published" if line.published else "all" if line.people == "all" else ""
        cells = "".join(
            f"<td>{escape(text)}</td>" for text in (line.method, line.people, *line.cells)
        )
        body.append(f'<tr class="{kind}">{cells}</tr>')
    rows = "\n".join(body)
    return (
        f'<h3 id="{table.name}">{escape(table.title)}</h3>\n<div class="wide"><table>'
        f"<thead><tr>{head}</tr></thead><tbody>\n{rows}\n</tbody></table></div>"
    )


def _titles(table: ReportTable) -> Iterable[str]:
    return (column.title for column in table.columns)


def _figure(image: ReportFigure) -> str:
    source = _data("image/png", image.png)
    title = escape(image.title)
    return f'<h3>{title}</h3>\n<img alt="{title}" src="{source}">'


def _filmstrip(filmstrip: Filmstrip) -> str:
    cells = []
    for cell in filmstrip.images:
        lines = "<br>".join(map(escape, cell.lines))
        image = '<div class="blank"></div>'
        if cell.jpeg:
            image = f'<img alt="{escape(cell.title)}" src="{_data("image/jpeg", cell.jpeg)}">'
        cells.append(f"<figure>{image}<b>{escape(cell.title)}</b>{lines}</figure>")
    return (
        f"<h3>{escape(filmstrip.method)} on {escape(filmstrip.recording)}</h3>\n"
        f'<p>{escape(filmstrip.sentence)}</p>\n<div class="filmstrip">{"".join(cells)}</div>'
    )


def _recordings(scores: Sequence[RunScores]) -> str:
    head = ("recording", "people", "seconds", "frames", "visible share")
    recordings = {result.recording.name: result for result in reversed(scores)}
    rows = [
        (
            name,
            result.people,
            f"{result.scores.lifetimes.duration_s:.1f}",
            result.frames,
            "known" if result.has_visibility else "unknown: none counts as occluded",
        )
        for name, result in reversed(recordings.items())
    ]
    cells = "".join(f"<th>{name}</th>" for name in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(str(value))}</td>" for value in row) + "</tr>\n"
        for row in rows
    )
    return f"<table><thead><tr>{cells}</tr></thead><tbody>\n{body}</tbody></table>"


def _data(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
