"""Readers of ground truth by name, and the choice for a file."""

import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Protocol, runtime_checkable

from common import registry
from common.io.ros_bag_files import is_bag
from people4d.errors import SourceError
from people4d.messages import Truth
from services.gt_bridge.config import GtBridgeConfig

# Classes, imported on use: each takes the configuration, and can be iterated several times.
TRUTH_SOURCES: dict[str, str] = {
    "recording": "services.gt_bridge.sources.files:RecordingTruth",
    "rosbag": "services.gt_bridge.sources.ros:RosbagTruth",
    "npz": "services.gt_bridge.sources.files:NpzTruth",
    "csv": "services.gt_bridge.sources.csv_file:CsvTruth",
    "mot": "services.gt_bridge.sources.files:MotTruth",
    "ros2": "services.gt_bridge.sources.ros2:Ros2Truth",
}
ROS2 = re.compile(r"ros2(\+\w*)?:.*")
KINDS = {".csv": "csv", ".txt": "mot"}


def is_live(truth: str) -> bool:
    """Return whether truth comes from topics, not from a file."""
    return bool(ROS2.fullmatch(truth))


@runtime_checkable
class LiveTruthSource(Protocol):
    """Live truth, received in threads of the source."""

    @property
    def counters(self) -> Mapping[str, int]:
        """Dropped messages by cause."""

    @property
    def problem(self) -> str:
        """Reason why truth is missing, empty otherwise."""

    def start(self, wake: Callable[[], None]) -> None:
        """Start receiving; `wake` is called from other threads after each message."""

    def take_truth(self) -> list[Truth]:
        """Return the truth received since the last call."""

    def wake_s(self) -> float | None:
        """Return the monotonic time at which `take_truth` is due [s]; None: wait for `wake`."""

    def close(self) -> None:
        """Stop receiving."""


def open_truth(config: GtBridgeConfig) -> Iterable[Truth]:
    """Open the configured truth, empty for an empty path.

    ConfigError if the source is unknown, or its class cannot be found; SourceError if the file does
    not exist, or is invalid.
    """
    if not config.truth:
        return ()
    name = _kind_of(config.truth) if config.source == "auto" else config.source
    factory = registry.find("source", TRUTH_SOURCES, name, "auto")
    truth: Iterable[Truth] = factory(config)
    return truth


def _kind_of(truth: str) -> str:
    if is_live(truth):
        return "ros2"
    path = Path(truth)
    if not path.exists():
        raise SourceError(f"truth {path} does not exist", "Check the path.")
    if path.suffix == ".npz" or (path / "gt.npz").exists():
        return "npz"
    if path.suffix in KINDS and path.is_file():
        return KINDS[path.suffix]
    if is_bag(path):
        return "rosbag"
    if path.suffix == ".mcap" and path.is_file():
        return "recording"
    raise SourceError(
        f"truth {path} has an unsupported format",
        "Give a recording, a ROS bag, CSV, MOT text (.txt), gt.npz or its folder, or set source.",
    )
