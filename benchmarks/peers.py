"""The pipeline beside other packages who track people, from image to tracks, in the same run.

Ultralytics' `track`, and trackers of other packages on boxes from onnxruntime, on the same network
file; ours with the default network, too. `--peers` names the interpreter of their environment, see
`lib/peers/video.py`; `--int8` names the network quantised by `people4d models quantize`.
"""

import json
import subprocess
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np
import onnx

from benchmarks.lib import options
from benchmarks.lib.system.live_camera import StoredDemo
from benchmarks.lib.system.playback import (
    APART,
    TOGETHER,
    Arrangement,
    bare_hz,
    live,
    lockstep,
    play,
)
from benchmarks.lib.table import markdown, spread, write
from benchmarks.together import RATE_SHARE
from common.runtime.latency import percentiles

SCRIPT = Path(__file__).parent / "lib" / "peers" / "video.py"
REFERENCE = "Ultralytics' track"
# Metadata of files exported by Ultralytics
PROPERTIES = {"task": "pose", "stride": "32", "batch": "1", "imgsz": "[640, 640]"}
PROPERTIES |= {"names": "{0: 'person'}", "kpt_shape": "[17, 3]"}


def peers(python: str, model: Path, frames: int) -> dict[str, tuple[str, list[float]]]:
    """Return the version and the seconds of each frame of every peer.

    Args:
        python: Interpreter of their environment.
        model: Network of YOLOv8-pose.
        frames: Frames of the shipped recording, repeated.
    """
    shown = [frame.rgb for frame in StoredDemo()]
    images = np.array([shown[k % len(shown)] for k in range(frames)])
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "frames.npy", Path(folder) / "times.json"
        described = Path(folder) / model.name
        np.save(source, images)
        network = onnx.load(str(model))
        onnx.helper.set_model_props(network, PROPERTIES)
        onnx.save(network, str(described))
        command = [python, "-P", str(SCRIPT), str(source), str(described), str(target)]
        subprocess.run(command, check=True)
        found = json.loads(target.read_text(encoding="utf-8"))
    for name, one in found.items():
        if not one["tracks"]:
            raise RuntimeError(f"{name} found no people: nothing to compare")
    return {f"{name} {one['version']}": (name, one["times_s"]) for name, one in found.items()}


def ours(model: Path, int8: Path) -> dict[str, tuple[Arrangement, list[str]]]:
    """Return arrangements and settings of the detector by name."""
    yolo, yolo_int8 = [f"model={model}"], [f"model={int8}"]
    openvino = "engine=openvino"
    movenet_int8 = ["model=movenet-multipose-int8"]
    return {
        "ours, the same network": (APART, yolo),
        "ours, the same network, together": (TOGETHER, yolo),
        "ours, the same network, OpenVINO": (APART, [*yolo, openvino]),
        "ours, int8": (APART, yolo_int8),
        "ours, int8, OpenVINO": (APART, [*yolo_int8, openvino]),
        "ours, MoveNet float32": (APART, ["model=movenet-multipose"]),
        "ours, MoveNet int8 (default here)": (APART, movenet_int8),
        "ours, MoveNet int8, together": (TOGETHER, movenet_int8),
    }


def main() -> None:
    """Measure in turns and write the table."""
    parser = options.parser(__doc__, "shared")
    parser.add_argument("--peers", required=True, help="Python interpreter of their environment")
    parser.add_argument("--int8", type=Path, required=True, help="the network in 8 bits")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--frames", type=int, default=100)
    flags = parser.parse_args()
    model = flags.shared / "data" / "models" / "yolov8n-pose_640.onnx"
    rates_hz, age_ms = defaultdict[str, list[float]](list), defaultdict[str, list[float]](list)
    reference_hz: list[float] = []
    for number in range(flags.rounds):
        print(f"round {number + 1} of {flags.rounds}", flush=True)
        rates_hz["bare network, onnxruntime"].append(bare_hz(str(model)))
        for words, (name, times_s) in peers(flags.peers, model, flags.frames).items():
            rates_hz[words].append(len(times_s) / sum(times_s))
            age_ms[words] += [1e3 * s for s in times_s]
            if name == REFERENCE:
                reference_hz.append(rates_hz[words][-1])
        for words, (one, settings) in ours(model, flags.int8.resolve()).items():
            print(words, flush=True)
            run = play(lockstep(flags.frames), flags.frames, settings, one)
            rates_hz[words].append(run.rate_hz)
            paced = play(live(RATE_SHARE * run.rate_hz), flags.frames, settings, one)
            age_ms[words] += paced.end_to_end_ms
    rows = []
    for words, found in rates_hz.items():
        ratios = [a / b for a, b in zip(found, reference_hz, strict=True)]
        p50, _, p99 = percentiles(age_ms[words]) if age_ms[words] else (np.nan, np.nan, np.nan)
        latency = f"{p50:.1f}, {p99:.1f}" if age_ms[words] else ""
        rows.append([words, spread(found, "{:.1f}"), spread(ratios, "{:.2f}"), latency])
    write(
        __file__,
        "The pipeline beside other packages",
        "Frames of the shipped recording (640x480, three people) from memory, one network thread; "
        f"median (least to most) of {flags.rounds} rounds in turns, on two cores. The network is "
        "YOLOv8n-pose at 640x640; int8: quantised by `people4d models quantize`. Other packages "
        "call one function after the other, and give boxes and identities in the image. Ours are "
        "processes (or one, together) that give positions, velocities and yaws in 3D with "
        "re-identification to a subscriber through the router: rate in lock-step, latency from a "
        f"live camera at {RATE_SHARE:.0%} of it.",
        markdown(["", "frames a second", f"of {REFERENCE}", "latency p50, p99 [ms]"], rows),
    )
