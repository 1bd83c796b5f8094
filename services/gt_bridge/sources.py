"""The readers of truth by name, and which one suits a file."""

import importlib
from collections.abc import Iterable
from pathlib import Path

from common.errors import ConfigError, SourceError
from common.messages import Truth
from services.gt_bridge.config import GtBridgeConfig

MCAP_HEAD = b"\x89MCAP0\r\n"

# Imported on use. Each class takes the configuration and is iterated, each time from the start.
TRUTH_SOURCES: dict[str, str] = {
    "recording": "services.gt_bridge.recording:RecordingTruth",
    "rosbag": "services.gt_bridge.rosbag:RosbagTruth",
    "lab": "services.gt_bridge.lab:LabTruth",
}


def open_truth(config: GtBridgeConfig) -> Iterable[Truth]:
    """Open the configured truth; an empty path gives none.

    Raises:
        ConfigError: The source is unknown, or its class cannot be found.
        SourceError: The file is absent or not what it should be.
    """
    if not config.truth:
        return ()
    name = _kind_of(Path(config.truth)) if config.source == "auto" else config.source
    module, separator, kind = TRUTH_SOURCES.get(name, name).partition(":")
    if not separator:
        raise ConfigError(
            f"source {name!r} is unknown",
            f"Choose auto, {', '.join(TRUTH_SOURCES)}, or module:Class of your own.",
        )
    try:
        factory = getattr(importlib.import_module(module), kind)
    except (ImportError, AttributeError) as error:
        raise ConfigError(f"source {name!r} cannot be loaded: {error}") from error
    truth: Iterable[Truth] = factory(config)
    return truth


def _kind_of(path: Path) -> str:
    if not path.exists():
        raise SourceError(f"truth {path} does not exist", "Check the path.")
    if path.suffix == ".npz" or (path / "gt.npz").exists():
        return "lab"
    if path.suffix == ".mcap" and path.is_file():
        return "rosbag" if _is_ros(path) else "recording"
    if path.suffix in (".bag", ".db3") or (path / "metadata.yaml").exists():
        return "rosbag"
    raise SourceError(
        f"truth {path} is of no known kind",
        "Give a recording, a ROS bag, gt.npz or its folder, or set source.",
    )


def _is_ros(path: Path) -> bool:
    """Say whether the header of an MCAP file names a ROS profile."""
    with path.open("rb") as file:
        head = file.read(32)
    # Magic (8 bytes), opcode (1), length of the record (8), length of the profile (4), profile.
    return head.startswith(MCAP_HEAD) and head[21:24] == b"ros"
