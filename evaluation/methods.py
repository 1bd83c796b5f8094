"""Methods: the configuration of the services that detect, re-identify and track."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from common.config import load
from people4d.errors import ConfigError
from services.camera.config import CameraConfig
from services.detector.config import DetectorConfig
from services.presets import preset_settings
from services.reid.config import ReidConfig
from services.tracker.build import make_tracker
from services.tracker.config import TrackerConfig

T = TypeVar("T", bound=msgspec.Struct)

SERVICES = ("camera", "detector", "reid", "tracker")


@dataclass(frozen=True)
class Method:
    """Configuration of the services of one method."""

    name: str  # name of the preset
    camera: CameraConfig  # playback of recordings, without a source
    detector: DetectorConfig
    reid: ReidConfig | None  # configuration; None if the tracker uses no embeddings
    tracker: TrackerConfig

    def settings(self) -> dict[str, dict[str, Any]]:
        """Return all settings by service."""
        records = {"detector": self.detector, "reid": self.reid, "tracker": self.tracker}
        return {name: msgspec.to_builtins(one) for name, one in records.items() if one is not None}

    def text(self) -> str:
        """Return all settings, a line each."""
        return "\n".join(
            f"{service}.{field} = {json.dumps(value, ensure_ascii=False)}"
            for service, fields in self.settings().items()
            for field, value in fields.items()
        )


def read_methods(presets: Sequence[str], settings: Sequence[str] = ()) -> list[Method]:
    """Return the methods of presets, see `read_method`.

    ConfigError if a preset is unknown or repeated, or a setting is wrong.
    """
    methods = [read_method(preset, settings) for preset in presets]
    names = [method.name for method in methods]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ConfigError(f"preset {', '.join(twice)} is repeated", "Name each once.")
    return methods


def read_method(preset: str, settings: Sequence[str] = ()) -> Method:
    """Return the method of a preset or TOML file, as `people4d up --preset` would run it.

    Settings ("service.field=value") win over the preset. ConfigError if the preset or a setting is
    unknown, or a value is out of range.
    """
    fields: dict[str, list[str]] = {service: [] for service in SERVICES}
    for text in [*preset_settings(preset), *settings]:
        service, _, field = text.partition(".")
        if service not in fields:
            known = ", ".join(SERVICES)
            raise ConfigError(f"setting {text!r} names no running service", f"These are {known}.")
        fields[service].append(field)

    def record(kind: type[T], service: str) -> T:
        return load(kind, service, None, fields[service])

    tracker = record(TrackerConfig, "tracker")
    embeds = make_tracker(tracker).uses_embeddings
    return Method(
        name=Path(preset).stem if preset.endswith(".toml") else preset,
        camera=msgspec.structs.replace(record(CameraConfig, "camera"), source=""),
        # Boxes and positions are the same with and without crops.
        detector=msgspec.structs.replace(record(DetectorConfig, "detector"), crops=True),
        reid=record(ReidConfig, "reid") if embeds else None,
        tracker=tracker,
    )
