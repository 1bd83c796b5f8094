"""Frames a second of the gait cascade in one thread, and in an older checkout by turns.

Scenes of `benchmarks.gait_scenes` at 640x480, with detected boxes and keypoints and five points a
person.
Rates are by the processor's time; other load on the host lowers all of them. The colour layer is
alone, with 100 particles in a box of 150x250 px.
"""

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.lib import options
from benchmarks.lib.gait import cascade_times
from benchmarks.lib.table import markdown, spread, write
from evaluation.gait.report import read_run
from evaluation.gait.run import estimate_gait
from people4d.messages import CameraInfo
from services.gait.estimator import GaitFrame

ROOT = Path(__file__).resolve().parents[1]
STARTS = ("benchmarks.lib.gait.cascade_times",)
SCENES = {"one person": "judge_even", "three people": "judge_4"}
AIMS = {"one person": 100, "three people": 35, "colour layer": 1500}  # [frames/s]
FRAMES = 120  # Number of frames of a recording


def stored_frames(folder: Path) -> tuple[CameraInfo, list[Any]]:
    """Return calibration and frames with their observations, as plain values."""
    infos, frames = list[CameraInfo](), list[Any]()

    def on_frame(info: CameraInfo, frame: GaitFrame, _results: object) -> None:
        infos.append(info)
        people = [
            (one.id, one.box_xyxy_px, one.keypoints, one.depth_m, one.yaw_rad)
            for one in frame.observations
        ]
        frames.append((frame.stamp_ns, frame.rgb, frame.depth_mm, people, frame.fixed_from_optical))

    for _ in estimate_gait(
        read_run(str(folder), None, "", (f"camera.max_frames={FRAMES}",)), on_frame
    ):
        pass
    return infos[0], frames


def rates(checkout: Path, file: Path) -> dict[str, float]:
    """Return the rates of a checkout [frames/s]."""
    command = [sys.executable, cascade_times.__file__, str(file)]
    done = subprocess.run(
        command,
        env={**os.environ, "PYTHONPATH": str(checkout.resolve())},
        check=True,
        capture_output=True,
        text=True,
    )
    return dict(json.loads(done.stdout))


def main() -> None:
    """Measure by turns and write the table."""
    parser = options.parser(__doc__, "rounds", "quick")
    parser.add_argument("scenes", type=Path, help="folder of the scenes")
    parser.add_argument("--before", type=Path, help="checkout of older code")
    asked = parser.parse_args()
    checkouts = {"now": ROOT} | (
        {f"at {_commit(asked.before)}": asked.before} if asked.before else {}
    )
    found: dict[str, list[dict[str, float]]] = {name: [] for name in checkouts}
    with TemporaryDirectory() as folder:
        file = Path(folder) / "frames.pkl"
        file.write_bytes(
            pickle.dumps({name: stored_frames(asked.scenes / one) for name, one in SCENES.items()})
        )
        for number in range(1 if asked.quick else asked.rounds):
            print(f"round {number + 1}", flush=True)
            for name, checkout in checkouts.items():
                found[name].append(rates(checkout, file))
    rows = [
        [
            what,
            *(spread([one[what] for one in found[name]], "{:.0f}") for name in checkouts),
            f"{aim}",
        ]
        for what, aim in AIMS.items()
    ]
    write(
        __file__,
        "Speed of the gait cascade",
        (__doc__ or "").partition("\n\n")[2].strip(),
        markdown(["frames a second", *checkouts, "aim"], rows),
        dry=asked.quick,
    )


def _commit(checkout: Path) -> str:
    command = ["git", "-C", str(checkout), "rev-parse", "--short=7", "HEAD"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
