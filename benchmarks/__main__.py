"""Run one benchmark: `python -m benchmarks NAME`; without a name, list all benchmarks.

A group, such as `speed`, runs one after the other, with the options that all of them take.
"""

import importlib
import os
import subprocess
import sys
import time
from collections.abc import Sequence

GROUPS = {
    "accuracy": {
        "scoreboard": "all recordings of real people, with intervals, beside other packages",
        "thesis": "the methods of [PIC4SeR] and `best` on its seven scenarios in the lab",
        "ablation": "`best` without each of its parts, with intervals",
        "real_variations": "annotated people in augmented images, other orders and half the rate",
        "target": "the chosen person: wrong locks, re-acquisition, beside track identities",
        "postures": "postures, falls and gestures of simulated people, as geometry",
        "objects": "objects that are detected as people, and people, by `object_like`",
    },
    "speed": {
        "together": "services in one process and apart, beside the bare network; stages",
        "peers": "the pipeline beside other packages, from image to tracks",
        "own_work": "time of a frame outside the networks, and of the tracker by number of people",
        "load": "rate and latency by number of people, cameras and detectors",
    },
    "cameras": {"cameras": "four cameras in one tracker, and in two areas: hand-overs, faults"},
    "motion": {
        "moving_base": "tracks from a driving robot, with its odometry and without",
        "odometry": "odometry correction and dynamic survival on rotating robots",
        "prediction": "predicted positions beside constant velocity, and their calibration",
    },
    "gait": {
        "gait": "points and colours in the lab, beside the figures of [Liu 2018]",
        "gait_bodies": "points and steps of people of a second simulator",
        "gait_real": "steps of real people beside steps counted by hand",
        "gait_speed": "frames a second of the cascade, in one thread",
    },
    "faults": {
        "faults": "every service killed and hung: time to recovery, lost frames, identities"
    },
}


def main() -> None:
    """Run the named benchmark or group with the other arguments, or list all."""
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name == "readme" or any(name in group for group in GROUPS.values()):
        sys.argv[:2] = [f"python -m benchmarks {name}"]
        os.environ["OMP_NUM_THREADS"] = "1"  # as in every process of the system, before NumPy
        importlib.import_module("cv2").setNumThreads(1)
        importlib.import_module(f"benchmarks.{name}").main()
    elif name in GROUPS:
        sys.exit(run_group(name, sys.argv[2:]))
    else:
        for group, benchmarks in GROUPS.items():
            print(f"{group}:")
            for one, content in benchmarks.items():
                print(f"    {one:16} {content}")
        print("readme: figures of README from the tables")
        sys.exit("Usage: python -m benchmarks NAME [--help] [options]")


def run_group(group: str, arguments: Sequence[str]) -> str | None:
    """Run the benchmarks of a group, each in its own process; return the failed ones."""
    failed = []
    for number, name in enumerate(GROUPS[group], 1):
        print(f"{name}, {number} of {len(GROUPS[group])}", flush=True)
        begin_s = time.monotonic()
        command = [sys.executable, "-m", "benchmarks", name, *arguments]
        if subprocess.run(command, check=False).returncode:
            failed.append(name)
        print(f"{name}: {(time.monotonic() - begin_s) / 60:.1f} minutes", flush=True)
    return f"failed: {', '.join(failed)}" if failed else None


if __name__ == "__main__":
    main()
