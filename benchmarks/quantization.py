"""Networks of 8-bit integers beside those in float: time by engine and instructions, accuracy.

MoveNet's is the shipped one; with --others those of YOLOv8 in `--shared` are made here by
`people4d models quantize`, which takes many minutes. Accuracy is compared on frames of the lab
that calibrated nothing, and on marked real frames.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.lib.network_time import network_ms
from benchmarks.lib.table import markdown, spread, write
from benchmarks.real_inputs import ROOT
from benchmarks.score_calibration import matches_of_marks, real_frames
from common.inference.engines import open_session
from common.inference.onnx import OnnxSession
from common.inference.session import Engine
from common.io.weights import REPOSITORY, load_manifest
from evaluation.quantization.accuracy import compare, detect
from evaluation.recordings.rendered import HELD_OUT, RenderedFrame, render
from services.detector.config import ModelSettings
from services.detector.models.registry import find_factory

ROUNDS = 5
ENGINES: tuple[tuple[str, Engine, bool], ...] = (
    ("onnxruntime", "onnxruntime", False),
    ("OpenVINO", "openvino", False),
    ("OpenVINO held to VNNI", "openvino", True),
)
TIMES = ["network", "MB", *(f"{name} [ms]" for name, _, _ in ENGINES), "of float, each"]
LOSSES = ["network", "recall", "position", "yaw", "real: found", "boxes on no mark"]


def networks(shared: Path, scratch: Path, others: bool) -> Iterator[tuple[str, str, Path, Path]]:
    """Yield name, kind, file in float and file of integers; makes those that do not ship."""
    models = REPOSITORY / "models"
    yield (
        "movenet-multipose, 256x320",
        "movenet",
        models / "movenet-multipose.onnx",
        models / "movenet-multipose-int8.onnx",
    )
    for name in ("yolov8n-pose", "yolov8n-seg") if others else ():
        path, out = shared / "data" / "models" / f"{name}_640.onnx", scratch / f"{name}-int8.onnx"
        if not path.exists():
            continue
        command = [sys.executable, "-m", "deploy.cli", "models", "quantize", str(path)]
        done = subprocess.run([*command, "--out", str(out)], check=False)
        if done.returncode == 0:
            yield f"{name}, 640x640", name.replace("yolov8n", "yolov8"), path, out


def times(name: str, plain: Path, integers: Path) -> list[list[str]]:
    """Return the rows of one model: in float, and of integers beside it in the same rounds."""
    taken_ms: dict[tuple[Path, str], list[float]] = {}
    for _ in range(ROUNDS):
        for title, engine, only_vnni in ENGINES:
            for path in (plain, integers):
                taken_ms.setdefault((path, title), []).append(network_ms(path, engine, only_vnni))
    rows = []
    for what, path in ((f"{name}, float", plain), (f"{name}, integers", integers)):
        cells = [spread(taken_ms[path, title], "{:.1f}") for title, _, _ in ENGINES]
        ratios = [
            min(taken_ms[path, title]) / min(taken_ms[plain, title]) for title, _, _ in ENGINES
        ]
        shares = ", ".join(f"{ratio:.2f}" for ratio in ratios)
        rows.append([what, f"{path.stat().st_size / 1e6:.1f}", *cells, shares])
    return rows


def losses(
    name: str, kind: str, plain: Path, integers: Path, frames: list[RenderedFrame], shared: Path
) -> list[str]:
    """Return the row of one model: what integers lose against float, with either engine."""
    expected = detect(OnnxSession(plain), kind, frames)
    found = compare(frames, expected, detect(open_session(integers), kind, frames))
    cells = [f"{-100 * found.recall:+.1f} %", f"{1000 * found.position_m:+.1f} mm"]
    cells.append(f"{found.yaw_deg:+.2f} deg")
    real = [on_real(path, kind, shared) for path in (plain, integers)]
    if not any(marked for _, _, marked in real):
        return [name, *cells, "not run", "not run"]
    (before, wrong_before, marked), (after, wrong_after, _) = real
    return [
        name,
        *cells,
        f"{before} -> {after} of {marked}",
        f"{wrong_before} -> {wrong_after}",
    ]


def on_real(path: Path, kind: str, shared: Path) -> tuple[int, int, int]:
    """Return marked people found, boxes on none, and marks, on real frames."""
    if not shared.exists():
        return 0, 0, 0
    known = [model for model in load_manifest().values() if model.file == path.name]
    settings = ModelSettings(score_scale=known[0].score_scale if known else 1.0)
    model = find_factory(kind)(open_session(path), settings, kind)
    found = boxes = marked = 0
    for _, rgb, marks in real_frames(shared):
        people = model.detect(rgb)
        found += int(matches_of_marks(people, marks).sum())
        boxes += len(people)
        marked += len(marks)
    return found, boxes - found, marked


def main() -> None:
    """Measure every model that is there, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shared", type=Path, default=ROOT.parent / "shared")
    parser.add_argument("--others", action="store_true", help="YOLOv8, too")
    flags = parser.parse_args()
    shared: Path = flags.shared
    frames = list(render(HELD_OUT))
    people = sum(len(rendered.people) for rendered in frames)
    with tempfile.TemporaryDirectory() as scratch:
        made = list(networks(shared, Path(scratch), flags.others))
        speed = [row for name, _, *files in made for row in times(name, *files)]
        lost = [losses(*entry, frames, shared) for entry in made]
    write(
        __file__,
        "Networks of 8-bit integers",
        f"One run of the network on one thread; median (least to greatest) of {ROUNDS} rounds in "
        "which all take turns, and the least time as a part of that in float with the same engine. "
        "Held to VNNI: OpenVINO without AMX, by ONEDNN_MAX_CPU_ISA; onnxruntime uses AMX where the "
        "CPU has it.",
        markdown(TIMES, speed),
        f"What integers lose: on {people} views of people in {len(frames)} frames of the lab, and "
        "on real frames marked by hand (filinha, TUE). [PIC4SeR] quantised with Intel's tools to a "
        "loss of at most 1 % and ran 3.8, 8.1 and 9.1 times as fast.",
        markdown(LOSSES, lost),
    )


if __name__ == "__main__":
    main()
