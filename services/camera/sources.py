"""The sources by name, and how one is found from a path."""

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
    # By name, since the lab stands above the services: it uses their cameras and recordings.
    lab = importlib.import_module("lab.source")
    source: Source = lab.open_source(name.removeprefix(LAB), options)
    return source


# Imported on use: a process that plays a folder does not pay for ROS bags.
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
        options: What the kind of source takes; a plug-in gets them as keyword arguments.

    Raises:
        SourceError: There is no such source, or it cannot be read.
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
        SourceError: Nothing is there, or it is nothing that can be opened.
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
        f"source {source} is no recording that is known",
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
    except Exception as error:  # whatever a camera's SDK raises
        raise SourceError(f"camera {name} cannot be opened: {error}") from error
    if not isinstance(source, Source):
        raise SourceError(
            f"camera {name} is not a services.camera.source.Source", "Derive from it."
        )
    return source
