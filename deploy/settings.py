"""List of all settings, made from the configuration records and their comments."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_type_hints

import msgspec

import services
from common import registry
from common.field_comments import field_comments
from deploy.launcher.joined import config_record
from services.detector.config import shipped_model, shipped_orientation

# Defaults that are not a value of TOML: a setting must be given, may be left out, or is a table
REQUIRED, ABSENT, TABLE = "required", "absent", "table"
BY_PROCESSOR = "by the processor"
SHIPPED = (shipped_model, shipped_orientation)  # functions of such defaults
# Records that are not the configuration of a service, by the first part of their settings' names
OTHERS = {
    "camera.options (recording)": "services.camera.recording:RecordingOptions",
    "camera.options (rosbag)": "services.camera.ros.camera:RosbagOptions",
    "camera.options (folder)": "services.camera.folder.source:FolderOptions",
    "camera.options (ros2)": "services.camera.ros.live:LiveRosOptions",
    "camera.options (lab)": "lab.source:LabOptions",
    "watchdog": "deploy.launcher.hangs:WatchdogConfig",
    "lab": "lab.output.sequence:ErrorModels",
    "lab:random": "lab.random_options:RandomScene",
    "scenario": "lab.scenario:Scenario",
    "models": "common.io.weights:ModelFile",
}


class Setting(NamedTuple):
    """One setting."""

    name: str  # path, for services and cameras as in --set; "[]" marks a list of tables
    default: str
    meaning: str  # caption with the unit
    record: type[msgspec.Struct]  # record of the field


def all_settings() -> dict[str, list[Setting]]:
    """Return the settings of every service, source of frames and description of a scene."""
    names = sorted(file.parent.name for file in Path(services.__path__[0]).glob("*/config.py"))
    records = {name: config_record(name) for name in names}
    records |= {name: registry.find("record", OTHERS, name) for name in OTHERS}
    return {
        name: list(_settings(record, name.partition(" ")[0])) for name, record in records.items()
    }


def _settings(
    record: type[msgspec.Struct], prefix: str, values: msgspec.Struct | None = None
) -> Iterator[Setting]:
    """Yield the settings of a record; `values` replace the defaults of its fields.

    A table with a comment is a setting, followed by the settings in it.
    """
    comments, hints = field_comments(record), get_type_hints(record)
    for field in msgspec.structs.fields(record):
        name, comment = f"{prefix}.{field.name}", comments[field.name]
        default = getattr(values, field.name) if values else _default(field)
        tables = _tables(hints[field.name])
        if comment or not tables:
            by_processor = field.default_factory in SHIPPED
            yield Setting(name, BY_PROCESSOR if by_processor else _text(default), comment, record)
        for table in tables:
            if isinstance(default, table):
                yield from _settings(table, name, default)
            else:
                yield from _settings(table, f"{name}[]")


def _default(field: msgspec.structs.FieldInfo) -> Any:
    """Return the default of a field; NODEFAULT if it is required."""
    if field.default_factory is not msgspec.NODEFAULT:
        return field.default_factory()
    return field.default


def _tables(hint: Any) -> list[type[msgspec.Struct]]:
    """Return the record types in the type of a field."""
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        return [hint]
    return [table for part in get_args(hint) for table in _tables(part)]


def _text(value: Any) -> str:
    """Return a default as a value of TOML, or in words if there is none."""
    if value is msgspec.NODEFAULT:
        return REQUIRED
    if value is None:
        return ABSENT
    if isinstance(value, msgspec.Struct):
        return TABLE
    if isinstance(value, str | bool):
        # A JSON string without escapes above ASCII is a TOML string.
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, tuple):
        return f"[{', '.join(map(_text, value))}]"
    return f"{value}"
