"""Write the figures of README.md from the tables: `python -m benchmarks readme`.

Figures of a table that is older than its code are not shown; a line below names such tables.
`--check` fails if README differs from what the command would write.
"""

import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.lib import options
from benchmarks.lib.system.bare import FLOAT
from benchmarks.lib.table import markdown
from scripts import table_age

BEGIN, END = "<!-- figures -->", "<!-- /figures -->"
BLOCK = re.compile(f"{BEGIN}.*?{END}", re.DOTALL)
INT8 = f"Detector: model={FLOAT}-int8"


class Table:
    """Figures of a file with tables."""

    def __init__(self, path: Path) -> None:
        self._name, self._rows = path.name, list(_rows(path.read_text("utf-8")))

    def cell(self, column: str, *labels: str, section: str = "") -> str:
        """Return the cell of the row that begins with these labels.

        LookupError if there is no such cell.

        Args:
            column: Title of the column, or its beginning.
            labels: First cells of the row.
            section: Beginning of the heading above the table.
        """
        for heading, row in self._rows:
            if heading.startswith(section) and tuple(row.values())[: len(labels)] == labels:
                for title, cell in row.items():
                    if title.startswith(column):
                        return cell
        raise LookupError(f"{self._name} has no {column!r} of {labels} in {section!r}")

    def best(self, column: str, label: str, section: str = "") -> str:
        """Return the highest cell of a column among rows whose first cell begins with a pattern.

        LookupError if there is no such row.
        """
        here = [row for heading, row in self._rows if heading.startswith(section)]
        rows = [row for row in here if column in row and re.match(label, next(iter(row.values())))]
        if not rows:
            raise LookupError(f"{self._name} has no {column!r} of {label!r}")
        return max((row[column] for row in rows), key=number)


def _rows(text: str) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield the rows of all tables, by column, with the heading above; columns need no title."""
    heading, header = "", list[str]()
    for line in text.splitlines():
        if not line.startswith("|"):
            heading = line.lstrip("# ") if line.startswith("## ") else heading
            header = []
        elif not header:
            header = [title or f" {k}" for k, title in enumerate(_cells(line))]
        elif not line.startswith("| ---"):
            yield heading, dict(zip(header, _cells(line), strict=True))


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def number(cell: str) -> float:
    """Return the first number of a cell."""
    found = re.search(r"-?\d+(\.\d+)?", cell)
    if not found:
        raise LookupError(f"{cell!r} has no number")
    return float(found[0])


def median(cell: str) -> str:
    """Return a cell without its spread or interval."""
    return re.split(r" [(\[]", cell)[0]


def real_people(table: Table) -> str:
    """Return the identity of annotated people, and of the best other package on the same boxes."""
    ours = table.cell("identity %", "MoveNet, appearance (default)", section="filinha")
    other = table.best("identity %", "MoveNet, [^:]+: ", "filinha")
    return f"identity correct in {ours} %; best other package {other} %"


def simulated(table: Table) -> str:
    """Return the figures of the second simulator."""
    columns = ("position m", "velocity m/s", "yaw deg", "switches a min", "IDF1 %")
    cells = [median(table.cell(c, "preset best", section="second simulator")) for c in columns]
    form = "position RMSE {} m, velocity {} m/s, yaw {} degrees, {} ID switches a minute, IDF1 {} %"
    return form.format(*cells)


def mot15(table: Table) -> str:
    """Return the figures of SORT in the image and of the best other packages."""
    columns = ("MOTA %", "IDF1 %", "HOTA %")
    ours = [(c[:4], table.cell(c, "preset image-sort-dynamic", section="MOT15")) for c in columns]
    others = [(c[:4], table.best(c, "(?!preset)", "MOT15")) for c in columns]
    ours_, others_ = (
        ", ".join(f"{name} {median(cell)}" for name, cell in cells) for cells in (ours, others)
    )
    return f"{ours_}; best of other packages: {others_}"


def of_arrangements(*figures: tuple[str, str, str]) -> Callable[[Table], str]:
    """Return a function that formats figures (load, figure, unit), together and apart."""

    def text(table: Table) -> str:
        parts = []
        for one in ("together", "apart"):
            cells = [
                f"{median(table.cell('median', one, load, figure, section=INT8))}{unit}"
                for load, figure, unit in figures
            ]
            parts.append(f"{one} {', '.join(cells)}")
        return "; ".join(parts)

    return text


def peers(table: Table) -> str:
    """Return the rate as a share of the bare network, for ours and the best other package."""
    column = "of the bare network, onnxruntime"
    ours = f"{median(table.cell(column, 'ours, the same network, together'))} of the bare network"
    try:
        return f"{ours}; best other package {median(table.best(column, '^(?!ours|bare)'))}"
    except LookupError:  # a run without --peers
        return ours


def own_work(table: Table) -> str:
    """Return the time of a frame outside the networks as a share of one float32 inference."""
    share = table.cell("median", "part of a run of the float network")
    return f"{median(share)} of one float32 inference"


def tracker_cost(table: Table) -> str:
    """Return the tracker's time by number of people."""
    cells = [f"{median(table.cell('p50 ms', 'best', n))} ms with {n}" for n in ("3", "50", "128")]
    return ", ".join(cells)


def faults(table: Table) -> str:
    """Return the pause of tracks after a detector's fault, and the share of kept identities."""
    silences = [median(table.cell("silence", "detector", kind)) for kind in ("killed", "hung")]
    counts = [table.cell("kept", "tracker", kind) for kind in ("killed", "hung")]
    return (
        f"detector: no tracks for {silences[0]} s and {silences[1]} s; tracker: identities kept "
        f"in {counts[0]} and {counts[1]}"
    )


@dataclass(frozen=True)
class Row:
    """A row of README."""

    what: str
    table: str
    text: Callable[[Table], str]


LATENCY = "all but inference, {} [ms]"
ROWS = (
    Row("six annotated real people in a room, the same boxes for all", "scoreboard", real_people),
    Row("simulated people of a second simulator, test split", "scoreboard", simulated),
    Row("MOT15, three sequences not tuned on, boxes alone", "scoreboard", mot15),
    Row(
        "frames a second, int8; part of the bare network",
        "together",
        of_arrangements(
            ("lock-step", "frames a second", " Hz"), ("lock-step", "part of the bare network", "")
        ),
    ),
    Row(
        "latency without inference at 30 Hz, median and 99th percentile",
        "together",
        of_arrangements(
            ("30 Hz", LATENCY.format("p50"), " ms"), ("30 Hz", LATENCY.format("p99"), " ms")
        ),
    ),
    Row(
        "memory of four services and the router",
        "together",
        of_arrangements(("30 Hz", "memory with the router [MB]", " MB")),
    ),
    Row("YOLOv8n-pose from image to tracks, in one process", "peers", peers),
    Row("time per frame outside the networks, one thread", "own_work", own_work),
    Row("tracker, by number of people", "own_work", tracker_cost),
    Row("a service killed; hung", "faults", faults),
)


def block() -> str:
    """Return the block of figures from the tables that are as new as their code."""
    folder = table_age.ROOT / "benchmarks"
    older = {name: table_age.age(folder / f"{name}.md") for name in {row.table for row in ROWS}}
    parts = []
    rows = [
        [f"{row.what} ({_link(row.table)})", row.text(Table(folder / f"{row.table}.md"))]
        for row in ROWS
        if not older[row.table]
    ]
    if rows:
        parts.append(markdown(("what", "measured"), rows))
    if names := [_link(name) for name in sorted(older) if older[name]]:
        parts.append(f"Outdated tables, not shown here: {', '.join(names)}.")
    return "\n".join((BEGIN, "\n\n".join(parts), END))


def _link(table: str) -> str:
    return f"[{table}](benchmarks/{table}.md)"


def written(text: str) -> str:
    """Return README.md with the present block; ValueError if it has no place for the block."""
    if not BLOCK.search(text):
        raise ValueError(f"README.md has no {BEGIN} and {END}")
    made = block()
    return BLOCK.sub(lambda _: made, text)


def main() -> None:
    """Write README.md, or check it."""
    parser = options.parser(__doc__)
    parser.add_argument("--check", action="store_true", help="fail if README differs")
    asked = parser.parse_args()
    path = table_age.ROOT / "README.md"
    text = path.read_text("utf-8")
    if (table_age.git("rev-parse", "--is-shallow-repository") or "true").strip() == "true":
        sys.exit(None if asked.check else "The age of tables needs the whole history of git.")
    new = written(text)
    if asked.check and new != text:
        sys.exit("README.md differs from the tables: run `python -m benchmarks readme`")
    if not asked.check:
        path.write_text(new, encoding="utf-8")
