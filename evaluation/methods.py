"""A method as its services would run it: configuration file, environment, preset, settings."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import msgspec

from common.config import load
from deploy.launcher.plan import CONFIG_FILE
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
    """What is judged.

    Args:
        name: Of the preset.
        camera: How recordings are played, without a source.
        detector: What finds people.
        reid: What tells their appearance; None if the tracker does not look at people.
        tracker: What follows them.
    """

    name: str
    camera: CameraConfig
    detector: DetectorConfig
    reid: ReidConfig | None
    tracker: TrackerConfig

    def text(self) -> str:
        """Return all settings, a line each."""
        records = {"detector": self.detector, "reid": self.reid, "tracker": self.tracker}
        return "\n".join(
            f"{service}.{field} = {json.dumps(value, ensure_ascii=False)}"
            for service, record in records.items()
            if record is not None
            for field, value in msgspec.to_builtins(record).items()
        )


def read_methods(presets: Sequence[str], settings: Sequence[str] = ()) -> list[Method]:
    """Return the methods of presets, see `read_method`.

    Raises:
        ConfigError: A preset is unknown or comes twice, or a setting is wrong.
    """
    methods = [read_method(preset, settings) for preset in presets]
    names = [method.name for method in methods]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ConfigError(f"preset {', '.join(twice)} comes twice", "Name each once.")
    return methods


def read_method(
    preset: str, settings: Sequence[str] = (), config_file: Path = CONFIG_FILE
) -> Method:
    """Return the method of a preset, as `people4d up --preset` would run it.

    Args:
        preset: Name of a preset, or path of a TOML file of that form.
        settings: "service.field=value", which win over the preset.
        config_file: A table for each service, over which the preset wins.

    Raises:
        ConfigError: The preset or a setting is unknown, or a value is out of range.
    """
    told: dict[str, list[str]] = {service: [] for service in SERVICES}
    for text in [*preset_settings(preset), *settings]:
        service, _, field = text.partition(".")
        if service not in told:
            known = ", ".join(SERVICES)
            raise ConfigError(f"setting {text!r} is of no service that runs", f"These are {known}.")
        told[service].append(field)

    def record(kind: type[T], service: str) -> T:
        return load(kind, service, config_file, told[service])

    tracker = record(TrackerConfig, "tracker")
    looks = make_tracker(tracker).uses_embeddings
    return Method(
        name=Path(preset).stem if preset.endswith(".toml") else preset,
        camera=msgspec.structs.replace(record(CameraConfig, "camera"), source=""),
        # Detections do not depend on whether pictures of people are cut out, too.
        detector=msgspec.structs.replace(record(DetectorConfig, "detector"), crops=True),
        reid=record(ReidConfig, "reid") if looks else None,
        tracker=tracker,
    )
