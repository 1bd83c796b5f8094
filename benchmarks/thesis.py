"""The methods of [PIC4SeR], the same with the shipped model, and `best`, on its seven scenarios.

The first third of each scenario is rendered and stored: a quarter of an hour of one core. Detection
takes twice as long.
"""

import re
import tempfile
from pathlib import Path

from benchmarks.lib import options
from benchmarks.lib.table import markdown, write
from deploy.cli.terminal import progress
from evaluation.cache import default_folder
from evaluation.evaluate import Evaluation, evaluate
from evaluation.methods import Method, read_method
from evaluation.recordings.recordings import plan_recordings
from evaluation.report.page import write as write_report
from evaluation.report.tables import ReportTable
from evaluation.run.preparation import EvaluationPlan

SEED = 51
DURATION_S = 20.0  # duration of each scene [s]
FOLDER = Path(__file__).parents[1] / "lab" / "scenarios"
SCENARIOS = (
    *("two_easy", "two_crossing", "three_easy", "three_crossing"),
    *("three_dense", "four_crossing", "four_dense"),
)
STRIDE = 2  # YOLOv8n gets every second frame, because it takes 0.1 s for a frame
SHIPPED = ("seg-sort-movenet", "seg-strongsort-movenet", "pose-strongsort-movenet", "best")
# Methods whose models are not shipped: preset, model, and whether the embedder is OSNet.
OTHERS = (
    ("seg-sort", "yolov8n-seg", False),
    ("seg-strongsort", "yolov8n-seg", True),
    ("pose-strongsort", "yolov8n-pose", True),
    ("best", "yolov8n-pose", True),
)


def main() -> None:
    """Evaluate all methods and write their tables."""
    parser = options.parser(__doc__, "shared", "jobs")
    parser.add_argument("--shipped-only", action="store_true", help="without YOLOv8n")
    parser.add_argument(
        "--out", type=Path, default=Path("out/thesis"), help="folder of the HTML report"
    )
    arguments = parser.parse_args()
    methods = [read_method(name) for name in SHIPPED]
    if not arguments.shipped_only:
        methods += _others(arguments.shared / "data" / "models")
    with tempfile.TemporaryDirectory() as scratch:
        recordings = plan_recordings(_scenes(Path(scratch)), (SEED,), "colour", default_folder())
        plan = EvaluationPlan(tuple(methods), tuple(recordings), default_folder(), arguments.jobs)
        with progress() as report:
            evaluation = evaluate(plan, report)
    write_report(plan, evaluation, arguments.out, "python -m benchmarks thesis")
    write(__file__, "[PIC4SeR]'s methods on its scenarios", *_parts(evaluation))


def _scenes(folder: Path) -> list[str]:
    """Write shortened scenarios to a folder; return their names."""
    for name in SCENARIOS:
        text = (FOLDER / f"{name}.toml").read_text(encoding="utf-8")
        text = re.sub(r"(?m)^duration_s = .*$", f"duration_s = {DURATION_S}", text)
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    return [f"lab:{folder / name}.toml" for name in SCENARIOS]


def _others(folder: Path) -> list[Method]:
    methods = []
    with tempfile.TemporaryDirectory() as scratch:
        for preset, model, embedder in OTHERS:
            lines = [
                f'extends = "{preset}"',
                f'[detector]\nmodel = "{folder / f"{model}_640.onnx"}"',
            ]
            if embedder:
                osnet = folder / "osnet_x0_25_msmt17.onnx"
                lines.append(f'[reid]\nembedder = "osnet"\nmodel = "{osnet}"')
            file = Path(scratch) / f"{preset}-yolov8n.toml"
            file.write_text("\n".join(lines), encoding="utf-8")
            methods.append(read_method(str(file), [f"camera.stride={STRIDE}"]))
    return methods


def _parts(evaluation: Evaluation) -> list[str]:
    parts = [
        f"Scenes: lab:{', '.join(SCENARIOS)}, seed {SEED}; the first {DURATION_S:.0f} s at 30 "
        "frames a second each, colour and measured depth. "
        "No frame is skipped, but methods with YOLOv8n get every second one. Mean and standard "
        "deviation over recordings. Rows of [PIC4SeR] come from its own recordings of real people. "
        "docs/methods/evaluation.md explains the columns. Not held out for `best`: the scale of "
        "its measurement noise was chosen on these scenes."
    ]
    for table in evaluation.tables:
        if not table.name.startswith("apart"):
            parts += [f"## {table.title}", _text(table)]
    return parts


def _text(table: ReportTable) -> str:
    columns = [k for k, one in enumerate(table.columns) if not one.title.startswith("within")]
    rows = [
        [row.method, *(row.cells[k] for k in columns)] for row in table.rows if row.people == "all"
    ]
    return markdown(["method", *(table.columns[k].title for k in columns)], rows)
