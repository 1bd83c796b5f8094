"""The methods of [PIC4SeR], the same with the shipped model, and `best`, on its seven scenarios.

The first run renders the scenes in half an hour on two cores; detection for each method takes
longer.
"""

import tempfile
from collections.abc import Sequence
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
    parser.add_argument("--scenes", nargs="+", default=[f"lab:{s}@{SEED}" for s in SCENARIOS])
    parser.add_argument("--shipped-only", action="store_true", help="without YOLOv8n")
    parser.add_argument(
        "--out", type=Path, default=Path("out/thesis"), help="folder of the HTML report"
    )
    arguments = parser.parse_args()
    methods = [read_method(name) for name in SHIPPED]
    if not arguments.shipped_only:
        methods += _others(arguments.shared / "data" / "models")
    recordings = plan_recordings(arguments.scenes, (), "colour", default_folder())
    plan = EvaluationPlan(tuple(methods), tuple(recordings), default_folder(), arguments.jobs)
    with progress() as report:
        evaluation = evaluate(plan, report)
    write_report(plan, evaluation, arguments.out, "python -m benchmarks thesis")
    write(__file__, "[PIC4SeR]'s methods on its scenarios", *_parts(evaluation, arguments.scenes))


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


def _parts(evaluation: Evaluation, scenes: Sequence[str]) -> list[str]:
    parts = [
        f"Scenes: {', '.join(scenes)}; 60 s at 30 frames a second each, colour and measured depth. "
        "No frame is skipped, but methods with YOLOv8n get every second one. Mean and standard "
        "deviation over recordings. Rows of [PIC4SeR] come from its own recordings of real people. "
        "docs/methods/evaluation.md explains the columns. Not held out for `best`: the scale of "
        "its measurement noise was chosen on these scenes.",
    ]
    for table in evaluation.tables:
        if not table.name.startswith("apart"):
            parts += [f"## {table.title}", _text(table)]
    return parts


def _text(table: ReportTable) -> str:
    rows = [[row.method, *row.cells] for row in table.rows if row.people == "all"]
    return markdown(["method", *(column.title for column in table.columns)], rows)
