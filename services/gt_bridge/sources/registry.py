"""Readers of ground truth by name, and the one that suits a file."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

from common import registry
from common.io.mcap_index import read_profile
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
}
SCHEME = "zenoh:"  # before the key of live truth
KINDS = {".csv": "csv", ".txt": "mot"}


@runtime_checkable
class LiveTruthSource(Protocol):
    """Truth that is captured now.

    Attributes:
        topics: Topics of other programs that bring it.
    """

    topics: Sequence[ForeignTopic]


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
    path = Path(truth)
    if not path.exists():
        raise SourceError(f"truth {path} does not exist", "Check the path.")
    if path.suffix == ".npz" or (path / "gt.npz").exists():
        return "npz"
    if path.suffix in KINDS and path.is_file():
        return KINDS[path.suffix]
    if path.suffix == ".mcap" and path.is_file():
        return "rosbag" if read_profile(path).startswith("ros") else "recording"
    if path.suffix in (".bag", ".db3") or (path / "metadata.yaml").exists():
        return "rosbag"
    raise SourceError(
        f"truth {path} is of no known kind",
        "Give a recording, a ROS bag, CSV, MOT text (.txt), gt.npz or its folder, or set source.",
    )
