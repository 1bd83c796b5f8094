"""Sources by kind, and the kind of a path."""

import importlib
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from common import registry
from common.io.mcap_index import read_profile
from people4d.errors import ConfigError, SourceError
from services.camera.source import Source

T = TypeVar("T", bound=msgspec.Struct)

Factory = Callable[[str, Mapping[str, Any]], Source]

LAB = "lab:"  # before the name of a scenario
PLUGIN = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")


def _recording(path: str, options: Mapping[str, Any]) -> Source:
    from services.camera.recording import RecordingOptions, RecordingSource  # noqa: PLC0415

    return RecordingSource(Path(path), read_options(RecordingOptions, options))


def _rosbag(path: str, options: Mapping[str, Any]) -> Source:
    from services.camera.ros.camera import RosbagOptions  # noqa: PLC0415
    from services.camera.ros.source import RosbagSource  # noqa: PLC0415

    return RosbagSource(Path(path), read_options(RosbagOptions, options))


def _folder(path: str, options: Mapping[str, Any]) -> Source:
    from services.camera.folder.source import FolderOptions, FolderSource  # noqa: PLC0415

    return FolderSource(Path(path), read_options(FolderOptions, options))


def _lab(name: str, options: Mapping[str, Any]) -> Source:
    # By name, since the lab is a layer above the services.
    lab = importlib.import_module("lab.source")
    source: Source = lab.open_source(name.removeprefix(LAB), options)
    return source


# Imported on use, since ROS bags take long to import.
SOURCES: dict[str, Factory] = {
    "recording": _recording,
    "rosbag": _rosbag,
    "folder": _folder,
    "lab": _lab,
}


def open_source(
    source: str, kind: str = "auto", options: Mapping[str, Any] | None = None
) -> Source:
    """Open a recording, a bag, a folder, a scenario of the virtual lab or a plug-in camera.

    Args:
        source: Path, `lab:NAME` of a scenario, or `module:Class` of a plug-in camera.
        kind: Name in SOURCES, "plugin", or "auto" to find it from the path.
        options: Of the kind of source; a plug-in gets them as keyword arguments.

    Raises:
        SourceError: The source does not exist or cannot be read.
        ConfigError: An option is unknown or wrong.
    """
    options = options or {}
    if kind == "auto":
        kind = kind_of(source)
    if kind == "plugin":
        return _plugin(source, options)
    if kind not in SOURCES:
        names = ", ".join(["auto", *SOURCES, "plugin"])
        raise ConfigError(f"kind: expected one of {names}, got {kind!r}")
    return SOURCES[kind](source, options)


def kind_of(source: str) -> str:
    """Return the kind of source that a path, `lab:NAME` or `module:Class` names.

    Raises:
        SourceError: The path does not exist, or is of no known kind.
    """
    path = Path(source)
    if not source or not path.exists():
        if source.startswith(LAB):
            return "lab"
        if PLUGIN.fullmatch(source):
            return "plugin"
        raise SourceError(
            f"source {source!r} does not exist",
            "Give a recording, a ROS bag, a folder of images, lab:SCENARIO or module:Class.",
        )
    if path.is_dir():
        bag = (path / "metadata.yaml").exists() or any(path.glob("*.db3"))
        return "rosbag" if bag else "folder"
    if path.suffix in (".bag", ".db3"):
        return "rosbag"
    if path.suffix == ".mcap":
        return "rosbag" if read_profile(path).startswith("ros") else "recording"
    raise SourceError(
        f"source {source} is not a known kind of recording",
        "Known are .bag, .db3, .mcap, folders of a ROS 2 bag and folders of images.",
    )


def read_options(kind: type[T], options: Mapping[str, Any]) -> T:
    """Build the options of a source.

    Raises:
        ConfigError: An option is unknown or wrong.
    """
    try:
        return msgspec.convert(dict(options), kind, strict=False)
    except msgspec.ValidationError as error:
        names = ", ".join(kind.__struct_fields__)
        raise ConfigError(f"options of the source: {error}", f"Options are {names}.") from error


def _plugin(name: str, options: Mapping[str, Any]) -> Source:
    try:
        factory = registry.find("camera", {}, name)
    except ConfigError as error:
        raise SourceError(
            error.problem,
            "Its folder must be on PYTHONPATH, its SDK installed in this environment.",
        ) from error
    try:
        source: object = factory(**options)
    except SourceError:
        raise
    except Exception as error:  # a camera's SDK may raise anything
        raise SourceError(f"camera {name} cannot be opened: {error}") from error
    if not isinstance(source, Source):
        raise SourceError(
            f"camera {name} is not a services.camera.source.Source", "Derive from it."
        )
    return source
