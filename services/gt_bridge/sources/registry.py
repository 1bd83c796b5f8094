"""Readers of ground truth by name, and the one that suits a file."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

from common import registry
from common.io.ros_bag_files import is_bag
from people4d.errors import SourceError
from people4d.messages import Truth
from people4d.topics import ForeignTopic
from services.gt_bridge.config import GtBridgeConfig

# Imported on use. Each class takes the configuration and is iterated, each time from the start. One
# for live truth is a LiveTruthSource, too.
TRUTH_SOURCES: dict[str, str] = {
    "recording": "services.gt_bridge.sources.files:RecordingTruth",
    "rosbag": "services.gt_bridge.sources.ros:RosbagTruth",
    "npz": "services.gt_bridge.sources.files:NpzTruth",
    "csv": "services.gt_bridge.sources.csv_file:CsvTruth",
    "mot": "services.gt_bridge.sources.files:MotTruth",
    "live": "services.gt_bridge.sources.ros:LiveTruth",
    "ros2": "services.gt_bridge.sources.ros2:Ros2Truth",
}
SCHEME = "zenoh:"  # before the key of live truth
ROS2 = re.compile(r"ros2(\+\w*)?:.*")
KINDS = {".csv": "csv", ".txt": "mot"}


@runtime_checkable
class LiveTruthSource(Protocol):
    """Truth that is captured now.

    Attributes:
        topics: Topics of other programs that bring it.
    """

    topics: Sequence[ForeignTopic]


def is_live(truth: str) -> bool:
    """Return whether truth comes from topics, not from a file."""
    return truth.startswith(SCHEME) or bool(ROS2.fullmatch(truth))


@runtime_checkable
class ReceivedTruthSource(Protocol):
    """Truth that the source receives itself, in threads of its own."""

    @property
    def counters(self) -> Mapping[str, int]:
        """Messages dropped, by cause."""

    @property
    def problem(self) -> str:
        """Reason for which there is no truth, empty if there is."""

    def start(self, wake: Callable[[], None]) -> None:
        """Begin to receive; `wake` is called from other threads after each message."""

    def take(self) -> list[Truth]:
        """Return what came since the last call."""

    def wake_s(self) -> float | None:
        """Return the monotonic time at which `take` is due by itself [s], None if at none."""

    def close(self) -> None:
        """End receiving."""


def open_truth(config: GtBridgeConfig) -> Iterable[Truth]:
    """Open the configured truth; an empty path gives none.

    Raises:
        ConfigError: The source is unknown, or its class cannot be found.
        SourceError: The file is absent or not what it should be.
    """
    if not config.truth:
        return ()
    name = _kind_of(config.truth) if config.source == "auto" else config.source
    factory = registry.find("source", TRUTH_SOURCES, name, "auto")
    truth: Iterable[Truth] = factory(config)
    return truth


def _kind_of(truth: str) -> str:
    if truth.startswith(SCHEME):
        return "live"
    if ROS2.fullmatch(truth):
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
        f"truth {path} is of no known kind",
        "Give a recording, a ROS bag, CSV, MOT text (.txt), gt.npz or its folder, or set source.",
    )
