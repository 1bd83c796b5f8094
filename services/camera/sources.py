"""Sources by kind, and the kind of a path."""

import re
from collections.abc import Mapping
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from common import registry
from common.config import Config
from common.io.ros_bag_files import is_bag, remedy_of
from people4d.errors import ConfigError, People4dError, SourceError
from people4d.messages import CameraInfo
from services.camera.config import CameraConfig
from services.camera.source import Source

Options = TypeVar("Options", bound=Config)

LAB = "lab:"  # prefix of the name of a scenario
ROS2 = re.compile(r"ros2(\+\w*)?:.*")
CAMERAS = "people4d.cameras"  # entry point of cameras with an SDK, by name
PLUGIN = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
# Classes are imported on use, since ROS bags take long to import and the lab is a higher layer.
SOURCES = {
    "recording": "services.camera.recording:RecordingSource",
    "rosbag": "services.camera.ros.source:RosbagSource",
    "folder": "services.camera.folder.source:FolderSource",
    "lab": "lab.source:LabSource",
    "ros2": "services.camera.ros.live:LiveRosSource",
}


def open_source(source: str, options: Mapping[str, Any] | None = None) -> Source:
    """Open a recording, a bag, a folder, a scenario of the lab, ROS 2 topics or a camera.

    SourceError if the source does not exist or cannot be read; ConfigError if an option is unknown
    or wrong.

    Args:
        source: Path, `lab:NAME` of a scenario, `ros2:/NAMESPACE` or `ros2:DRIVER` of ROS 2 topics,
            name of a camera with an SDK, or `module:Class` of a plug-in camera.
        options: Options of the kind of source; keyword arguments of a plug-in.
    """
    options = options or {}
    kind = kind_of(source)
    if kind in ("camera", "plugin"):
        return _plugin(source, options)
    factory = registry.find("source", SOURCES, kind)
    argument: str | Path = source.removeprefix(LAB) if kind in ("lab", "ros2") else Path(source)
    opened: Source = factory(argument, read_options(factory.options_type, options))
    return opened


def check_source(config: CameraConfig) -> None:
    """Check a source by opening it; only the process opens the lab and plug-ins.

    ConfigError if no source is named, or an option is wrong; SourceError if the source cannot be
    read.
    """
    if not config.source:
        raise ConfigError(
            "no camera is named",
            "Add --source PATH (recording, ROS bag, image folder, lab:SCENARIO, ros2:/camera, "
            "realsense, orbbec, oak, or module:Class of a camera), or see it work with: people4d "
            "demo",
        )
    if kind_of(config.source) not in ("lab", "plugin"):
        open_source(config.source, config.options).close()


def kind_of(source: str) -> str:
    """Return the kind of a path, `lab:NAME`, `module:Class` or a name; SourceError without one."""
    path = Path(source)
    if not source or not path.exists():
        if source.startswith(LAB):
            return "lab"
        if ROS2.fullmatch(source):
            return "ros2"
        if PLUGIN.fullmatch(source):
            return "plugin"
        if source in named_cameras():
            return "camera"
        raise SourceError(
            f"source {source!r} does not exist",
            "Give a recording, a ROS bag, a folder of images, lab:SCENARIO, ros2:/camera, "
            "module:Class, or a camera by name: people4d cameras.",
        )
    if is_bag(path):
        return "rosbag"
    if path.is_dir():
        return "folder"
    if path.suffix == ".mcap":
        return "recording"
    raise SourceError(
        f"source {source} is not a known kind of recording",
        remedy_of(path) or "Known are .bag, .db3, .mcap, and folders of a ROS 2 bag or of images.",
    )


def named_cameras() -> dict[str, str]:
    """Return the `module:Class` of each installed camera with an SDK by its name."""
    return {point.name: point.value for point in entry_points(group=CAMERAS)}


def camera_class(name: str) -> Any:
    """Import the class of a camera by its name, or as `module:Class`; ConfigError if it fails."""
    return registry.find("camera", named_cameras(), name)


def read_options(kind: type[Options], options: Mapping[str, Any]) -> Options:
    """Return the options of a source; ConfigError with the known ones if they are wrong."""
    try:
        return msgspec.convert(dict(options), kind, strict=False)
    except msgspec.ValidationError as error:
        names = ", ".join(kind.__struct_fields__)
        raise ConfigError(f"options of the source: {error}", f"Options are {names}.") from error


def _plugin(name: str, options: Mapping[str, Any]) -> Source:
    try:
        factory = camera_class(name)
    except ConfigError as error:
        raise SourceError(
            error.problem,
            "Its folder must be on PYTHONPATH, its SDK installed in this environment.",
        ) from error
    try:
        source: object = factory(**options)
    except People4dError:
        raise
    except Exception as error:  # a camera's SDK may raise any exception
        raise SourceError(f"camera {name} cannot be opened: {error}") from error
    if not isinstance(source, Source):
        raise SourceError(
            f"camera {name} is not a services.camera.source.Source", "Derive from it."
        )
    info = getattr(source, "info", None)
    if not (source.calibrates_late or isinstance(info, CameraInfo)):
        raise SourceError(
            f"camera {name} has no calibration: info is {type(info).__name__}, expected CameraInfo",
            "Set self.info in its constructor.",
        )
    return source
