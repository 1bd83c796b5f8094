"""Methods as named settings: one TOML file each, with a table for each service.

With `extends = "name"` a file extends and changes the settings of another one, shipped or in its
own folder. A preset configures only detection and tracking, without recordings and output folders.
"""

import difflib
import json
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from common.io.files import inside, read_toml
from people4d.errors import ConfigError

SERVICES = ("detector", "reid", "tracker", "gait")
FIELD = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,63}")
MAX_DEPTH = 8  # maximum depth of tables in a service's table
MAX_CHAIN = 16  # maximum number of presets in a chain of extensions

FOLDER = Path(__file__).parent
DEFAULTS = "best"  # name of the defaults, which have no file
PRESETS = {
    DEFAULTS: "the defaults: everything beyond the published methods, on the shipped models",
    "seg-sort": "the first method of PIC4SeR: YOLOv8-seg, SORT-3D, yaw as people walk",
    "seg-strongsort": "its second: YOLOv8-seg, StrongSORT-3D with OSNet, yaw as people walk",
    "pose-strongsort": "its third: YOLOv8-pose, StrongSORT-3D with OSNet, yaw from keypoints",
    "seg-sort-movenet": "the first on the shipped model: masks grown in depth from its keypoints",
    "seg-strongsort-movenet": "the second on the shipped models: grown masks, colour histograms",
    "pose-strongsort-movenet": "the third on the shipped models: keypoints, colour histograms",
    "image-sort": "boxes alone: SORT in the image, the base of Park (2021)",
    "image-sort-dynamic": "with dynamic survival: long tracks survive more unmatched frames",
    "image-sort-odom": "with the robot's turns corrected by odometry",
    "image-sort-odom-dynamic": "with both: the method of Park (2021)",
    "gait-spin": "points on the body by spin images alone, as in Liu (2018); with --gait",
    "gait-geodesic": "the same by geodesic distances alone",
}


def preset_settings(name: str) -> list[str]:
    """Return the settings of a preset as "service.field=value", later ones win.

    ConfigError if there is no such preset, or its file cannot be read.

    Args:
        name: One of PRESETS, or the path of a TOML file of that form; empty: the defaults.
    """
    settings: dict[str, str] = {}
    for tables in reversed(list(_chain(name))):
        for service, table in tables.items():
            if not isinstance(table, dict):
                raise ConfigError(
                    f"preset {name}: {service:.80} is not a table", "Write [service]."
                )
            if service not in SERVICES:
                raise ConfigError(
                    f"preset {name} sets {service:.80}, which is not part of a method",
                    f"Presets are for {', '.join(SERVICES)}; put the rest into a configuration.",
                )
            settings |= _flat(service, table, MAX_DEPTH)
    return [f"{path}={value}" for path, value in settings.items()]


def preset_file(name: str) -> Path | None:
    """Return the file of a preset, None for the defaults; ConfigError if it is unknown."""
    if name in ("", DEFAULTS):
        return None
    if name in PRESETS:
        return FOLDER / f"{name}.toml"
    if name.endswith(".toml"):
        return Path(name)
    near = difflib.get_close_matches(name[:80], PRESETS, 1)
    hint = f"Did you mean {near[0]}?" if near else f"There are {', '.join(PRESETS)}."
    raise ConfigError(f"unknown preset {name!r:.80}", hint)


def _chain(name: str) -> Iterator[dict[str, Any]]:
    """Yield the tables of a preset, then of the preset that it extends, and so on."""
    file = preset_file(name)
    files = set[Path]()
    while file:
        if file in files or len(files) == MAX_CHAIN:
            raise ConfigError(f"preset {file} extends itself")
        files.add(file)
        tables = _read(file)
        extended = tables.pop("extends", "")
        yield tables
        file = _extended(file, extended) if extended else None


def _extended(file: Path, name: Any) -> Path | None:
    """Return the file that a preset extends: shipped, or in its own folder."""
    if not isinstance(name, str):
        raise ConfigError(f"preset {file}: extends is not a name")
    if not name.endswith(".toml"):
        return preset_file(name)
    try:
        return inside(file.parent, name)
    except ValueError as error:
        raise ConfigError(f"preset {file} extends {name:.80}: {error}") from error


def _read(file: Path) -> dict[str, Any]:
    try:
        return read_toml(file)
    except OSError as error:
        raise ConfigError(f"preset {file} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(f"preset {file} is not TOML: {error}") from error


def _flat(path: str, table: Mapping[str, Any], depth: int) -> dict[str, str]:
    """Return the values of a table and of its sub-tables by path, in TOML."""
    found: dict[str, str] = {}
    for name, value in table.items():
        if not FIELD.fullmatch(name) or not depth:
            raise ConfigError(f"preset: {path:.80} has no field {name!r:.80}")
        below = f"{path}.{name}"
        found |= (
            _flat(below, value, depth - 1) if isinstance(value, dict) else {below: _toml(value)}
        )
    return found


def _toml(value: Any) -> str:
    # Numbers, booleans, text and lists have the same form in JSON, except infinity.
    if value == math.inf:
        return "inf"
    try:
        return json.dumps(value, ensure_ascii=False)
    except (TypeError, ValueError, RecursionError) as error:  # a date is no setting
        raise ConfigError(f"preset: {value!r:.80} is not a number, text or list of them") from error
