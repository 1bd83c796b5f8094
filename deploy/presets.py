"""Methods as named settings: one TOML file each, with a table for each service.

A file may name another one with `extends = "name"`, whose settings it then adds to and changes.
"""

import difflib
import json
import math
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from common.errors import ConfigError

FOLDER = Path(__file__).parent / "config" / "presets"
PRESETS = {
    "best": "everything that this project adds to the papers, on what is shipped",
    "seg-sort": "the paper's first method: YOLOv8-seg, SORT-3D, yaw as people walk",
    "seg-strongsort": "its second: YOLOv8-seg, StrongSORT-3D with OSNet, yaw as people walk",
    "pose-strongsort": "its third: YOLOv8-pose, StrongSORT-3D with OSNet, yaw from keypoints",
    "seg-sort-movenet": "the first on the shipped model: masks grown in depth from its keypoints",
    "seg-strongsort-movenet": "the second on the shipped models: grown masks, colour histograms",
    "pose-strongsort-movenet": "the third on the shipped models: keypoints, colour histograms",
}


def preset_settings(name: str) -> list[str]:
    """Return the settings of a preset as "service.field=value", later ones win.

    Args:
        name: One of PRESETS, or the path of a TOML file of that form; empty gives no settings.

    Raises:
        ConfigError: There is no such preset, or its file cannot be read.
    """
    settings: dict[str, str] = {}
    for tables in reversed(list(_chain(name))):
        for service, table in tables.items():
            if not isinstance(table, dict):
                raise ConfigError(f"preset {name}: {service} is not a table", "Write [service].")
            settings |= _flat(service, table)
    return [f"{path}={value}" for path, value in settings.items()]


def preset_file(name: str) -> Path:
    """Return the file of a preset.

    Raises:
        ConfigError: There is no such preset.
    """
    if name in PRESETS:
        return FOLDER / f"{name}.toml"
    if name.endswith(".toml"):
        return Path(name)
    near = difflib.get_close_matches(name, PRESETS, 1)
    mend = f"Did you mean {near[0]}?" if near else f"There are {', '.join(PRESETS)}."
    raise ConfigError(f"there is no preset {name!r}", mend)


def _chain(name: str) -> Iterator[dict[str, Any]]:
    """Yield the tables of a preset, then of what it extends, and so on."""
    seen = set[Path]()
    while name:
        file = preset_file(name)
        if file in seen:
            raise ConfigError(f"preset {file} extends itself")
        seen.add(file)
        tables = _read(file)
        name = str(tables.pop("extends", ""))
        yield tables


def _read(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"preset {file} cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"preset {file} is not TOML: {error}") from error


def _flat(path: str, table: Mapping[str, Any]) -> dict[str, str]:
    """Return the values of a table and of those below it by their path, written as TOML."""
    found: dict[str, str] = {}
    for name, value in table.items():
        below = f"{path}.{name}"
        found |= _flat(below, value) if isinstance(value, dict) else {below: _toml(value)}
    return found


def _toml(value: Any) -> str:
    # Numbers, truth values, text and lists of them are the same in JSON, but for infinity.
    return "inf" if value == math.inf else json.dumps(value, ensure_ascii=False)
