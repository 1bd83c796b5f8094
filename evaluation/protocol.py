"""Protocol of a report: versions, commit, settings, seeds, ground truth and hardware."""

import hashlib
import platform
import subprocess
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import msgspec
import psutil

from evaluation.methods import Method
from evaluation.recordings.ground_truth import SampledTruth
from evaluation.recordings.recordings import EvaluationRecording
from people4d.errors import SourceError

FILE = "protocol.json"
PACKAGES = ("people4d-robot", "numpy", "scipy", "opencv-python-headless", "onnxruntime", "openvino")
ROOT = Path(__file__).resolve().parents[1]


class RecordingProtocol(msgspec.Struct, frozen=True):
    """One recording of a report."""

    scenario: str
    seed: int | None
    frames: int  # number of frames with ground truth
    truth: str  # digest of the ground truth


class Protocol(msgspec.Struct, frozen=True):
    """Everything that determines the figures of a report."""

    command: str
    versions: dict[str, str]  # version of each package, and of Python
    commit: str  # commit of a clone, -dirty if files differ; empty without one
    machine: dict[str, Any]
    methods: dict[str, Any]  # settings of each method
    recordings: dict[str, RecordingProtocol]


def protocol_of(
    command: str, methods: Sequence[Method], recordings: dict[str, RecordingProtocol]
) -> Protocol:
    """Return the protocol of methods on recordings by name."""
    return Protocol(
        command=command,
        versions=versions(),
        commit=commit(),
        machine=machine(),
        methods={method.name: method.settings() for method in methods},
        recordings=recordings,
    )


def recording_protocol(recording: EvaluationRecording, truth: SampledTruth) -> RecordingProtocol:
    """Return the protocol of a recording."""
    frames = sum(frame is not None for frame in truth.frames)
    return RecordingProtocol(recording.scenario, recording.seed, frames, truth_digest(truth))


def read_protocol(path: Path) -> Protocol:
    """Read the protocol of a report; SourceError if it cannot be read."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=Protocol)
    except (OSError, msgspec.DecodeError) as error:
        raise SourceError(
            f"{path} cannot be read: {error}",
            "Name the folder of a report of people4d evaluate of this version.",
        ) from error


def truth_digest(truth: SampledTruth) -> str:
    """Return a digest of the people of all frames."""
    digest = hashlib.sha256(truth.frame_id.encode())
    for frame in truth.frames:
        people = frame.people if frame else None
        digest.update(msgspec.json.encode(people, enc_hook=lambda array: array.round(6).tolist()))
    return digest.hexdigest()[:16]


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that compute figures."""
    found = {"Python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def machine() -> dict[str, Any]:
    """Return processor, cores, memory and system."""
    processor, cpuinfo = platform.machine(), Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [x for x in cpuinfo.read_text().splitlines() if x.startswith("model name")]
        processor = names[0].partition(":")[2].strip() if names else processor
    memory_gib = round(psutil.virtual_memory().total / 2**30, 1)
    cores, system = psutil.cpu_count(), platform.platform()
    return {"processor": processor, "cores": cores, "memory_gib": memory_gib, "system": system}


def commit() -> str:
    """Return the commit of a clone, marked if files differ from it; empty without one."""
    head = _git("rev-parse", "HEAD") if (ROOT / ".git").exists() else ""
    changed = head and _git("diff", "--name-only", "HEAD")
    return f"{head}{'-dirty' if changed else ''}"


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(ROOT), *arguments]
    try:
        return subprocess.run(command, check=False, capture_output=True, text=True).stdout.strip()
    except OSError:  # without git
        return ""
