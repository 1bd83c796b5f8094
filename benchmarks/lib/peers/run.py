"""Trackers of other packages, run by `peers/mot.py` in an environment of their own."""

import json
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from people4d.messages import F64

STARTS = ("benchmarks.lib.peers.mot",)
SCRIPT = Path(__file__).with_name("mot.py")


@dataclass(frozen=True)
class PeerSequence:
    """Input of a tracker of boxes."""

    rows: F64  # frame from 1, left, top, right, bottom, score
    frames: int
    rate_hz: float


@dataclass(frozen=True)
class PeerRun:
    """Output of one tracker with one of its settings."""

    settings: str  # version of the package and settings, as text
    rows: dict[str, F64]  # tracks by sequence: frame from 1, identity, left, top, right, bottom
    times_us: dict[str, list[float]]  # times of frames by sequence

    def words(self, number: int) -> str:
        """Return version and settings as text, given the number of the setting."""
        return f"{self.settings.partition(': ')[0]}: own settings" if number == 0 else self.settings


def run_peers(
    python: str, sequences: Mapping[str, PeerSequence], chosen: Mapping[str, Sequence[int]]
) -> dict[str, dict[int, PeerRun]]:
    """Run the packages of others.

    Args:
        python: Interpreter of their environment.
        sequences: Detections by name.
        chosen: Numbers of settings by tracker; empty: all trackers with all settings.

    Returns:
        Runs by tracker and number of the setting; the first is the package's own.
    """
    arrays: dict[str, F64] = {}
    for name, one in sequences.items():
        arrays |= {name: one.rows, f"{name}:info": np.array([one.frames, one.rate_hz])}
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "detections.npz", Path(folder) / "tracks.npz"
        np.savez(source, allow_pickle=False, **arrays)
        command = [python, "-P", str(SCRIPT), str(source), str(target), json.dumps(chosen)]
        subprocess.run(command, check=True)
        with np.load(target) as file:
            outputs = dict(file)
    runs: dict[str, dict[int, PeerRun]] = {}
    for key in (key for key in outputs if key.endswith(":words")):
        tracker, _, number = key.removesuffix(":words").rpartition("/")
        label = f"{tracker}/{number}"
        runs.setdefault(tracker, {})[int(number)] = PeerRun(
            settings=f"{outputs[f'{tracker}:version']}: {outputs[key]}",
            rows={name: outputs[f"{label}/{name}"] for name in sequences},
            times_us={name: outputs[f"{label}/{name}:us"].tolist() for name in sequences},
        )
    return runs
