"""The pipeline compared with other packages for people tracking, from image to tracks, in one run.

The other packages are Ultralytics' `track`, and trackers on boxes from onnxruntime. All use the
same network file; the pipeline also runs with its default network. `--peers` names the interpreter
of the other packages, see `lib/peers/video.py`; without it, the pipeline runs alone. `--int8` names
the network quantised by `people4d models quantize`.
"""

import json
import subprocess
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np
import onnx

from benchmarks.lib import options
from benchmarks.lib.system.bare import FLOAT, bare_ms
from benchmarks.lib.system.live_camera import StoredDemo, frames_file
from benchmarks.lib.system.playback import APART, TOGETHER, Arrangement, live, lockstep, play
from benchmarks.lib.table import markdown, spread, write
from benchmarks.together import RATE_SHARE
from common.runtime.latency import percentiles

STARTS = ("benchmarks.lib.peers.video",)
SCRIPT = Path(__file__).parent / "lib" / "peers" / "video.py"
BARE = "bare network, onnxruntime"
ULTRALYTICS = "Ultralytics' track"
# Wanted rates, divided by Ultralytics' rate, by row
WANTED = {
    "ours, the same network": 1.05,
    "ours, int8": 2.2,
    "ours, MoveNet int8 (default here)": 5.0,
    "ours, MoveNet int8, together": 6.0,
}
HEADER = ("", "frames a second", f"of the {BARE}", f"of {ULTRALYTICS}", "wanted", "p50, p99 [ms]")
FRAMES, QUICK_FRAMES = 60, 10
# Metadata of files exported by Ultralytics
PROPERTIES = {"task": "pose", "stride": "32", "batch": "1", "imgsz": "[640, 640]"}
PROPERTIES |= {"names": "{0: 'person'}", "kpt_shape": "[17, 3]"}


def peers(python: str, model: Path, frames: int) -> dict[str, list[float]]:
    """Return the version and the seconds of each frame of every peer.

    Args:
        python: Interpreter of their environment.
        model: Network of YOLOv8-pose.
        frames: Frames of the shipped recording, repeated.
    """
    shown = [frame.rgb for frame in StoredDemo(frames_file(75))]
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
    return {f"{name} {one['version']}": one["times_s"] for name, one in found.items()}


def ours(model: Path, int8: Path | None) -> dict[str, tuple[Arrangement, list[str]]]:
    """Return arrangements and settings of the detector by name."""
    yolo, movenet = [f"model={model}"], f"model={FLOAT}"
    openvino = "engine=openvino"
    found = {
        "ours, the same network": (APART, yolo),
        "ours, the same network, together": (TOGETHER, yolo),
        "ours, the same network, OpenVINO": (APART, [*yolo, openvino]),
        "ours, MoveNet float32": (APART, [movenet]),
        "ours, MoveNet int8 (default here)": (APART, [f"{movenet}-int8"]),
        "ours, MoveNet int8, together": (TOGETHER, [f"{movenet}-int8"]),
    }
    if int8:
        found["ours, int8"] = (APART, [f"model={int8.resolve()}"])
        found["ours, int8, OpenVINO"] = (APART, [f"model={int8.resolve()}", openvino])
    return found


def main() -> None:
    """Measure all packages alternately and write the table."""
    parser = options.parser(__doc__, "shared", "rounds", "quick")
    parser.add_argument("--peers", help="Python interpreter of their environment")
    parser.add_argument("--int8", type=Path, help="the network in 8 bits")
    asked = parser.parse_args()
    rounds, frames = (1, QUICK_FRAMES) if asked.quick else (asked.rounds, FRAMES)
    model = asked.shared / "data" / "models" / "yolov8n-pose_640.onnx"
    rates_hz, age_ms = defaultdict[str, list[float]](list), defaultdict[str, list[float]](list)
    shares, beside = defaultdict[str, list[float]](list), defaultdict[str, list[float]](list)
    for number in range(rounds):
        print(f"round {number + 1} of {rounds}", flush=True)
        round_hz = {BARE: 1e3 / bare_ms(str(model))}
        if asked.peers:
            for words, times_s in peers(asked.peers, model, frames).items():
                round_hz[words] = len(times_s) / sum(times_s)
                age_ms[words] += [1e3 * s for s in times_s]
        for words, (one, settings) in ours(model, asked.int8).items():
            print(words, flush=True)
            round_hz[words] = play(lockstep(frames), frames, settings, one).rate_hz
            paced = play(live(RATE_SHARE * round_hz[words]), frames, settings, one)
            age_ms[words] += paced.end_to_end_ms
        for words, rate_hz in round_hz.items():
            rates_hz[words].append(rate_hz)
            shares[words].append(rate_hz / round_hz[BARE])
            for other in (name for name in round_hz if name.startswith(ULTRALYTICS)):
                beside[words].append(rate_hz / round_hz[other])
    rows = []
    for words, found in rates_hz.items():
        p50, _, p99 = percentiles(age_ms[words]) if age_ms[words] else (np.nan, np.nan, np.nan)
        latency = f"{p50:.1f}, {p99:.1f}" if age_ms[words] else ""
        ratio = spread(beside[words]) if beside[words] else ""
        wanted = f"at least {WANTED[words]}" if words in WANTED else ""
        rate = spread(found, "{:.1f}")
        rows.append([words, rate, spread(shares[words]), ratio, wanted, latency])
    write(
        __file__,
        "The pipeline beside other packages",
        "Frames of the shipped recording (640x480, three people) from memory, one network thread; "
        f"median (least to most) of {rounds} rounds of {frames} frames in turns, on two cores. The "
        "network is YOLOv8n-pose at 640x640; int8: quantised by `people4d models quantize`. Other "
        "packages, measured with `--peers`, call one function after the other, and give boxes and "
        "identities in the image. Ours are processes (or one, together) that give positions, "
        "velocities and yaws in 3D with re-identification to a subscriber through the router: rate "
        f"in lock-step, latency from a live camera at {RATE_SHARE:.0%} of it.",
        markdown(HEADER, rows),
        dry=asked.quick,
    )
