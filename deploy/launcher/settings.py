"""Settings of the services of a run, checked before anything is started."""

import importlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from common.config import load
from deploy.compose import Service


def read_settings(
    service: Service, file: Path, environment: Mapping[str, str], overrides: Sequence[str] = ()
) -> msgspec.Struct | None:
    """Read the settings of a service as its process will read them.

    Args:
        service: The service.
        file: TOML file with one table for each service.
        environment: Environment variables of the process.
        overrides: "field=value", which win.

    Returns:
        Its configuration; None for a program that is no service of this project.

    Raises:
        ConfigError: A setting is unknown or out of range, or the file cannot be read.
    """
    if not service.module.startswith("services."):
        return None
    name = service.module.rpartition(".")[2]
    module = importlib.import_module(f"{service.module}.config")
    kind: type[msgspec.Struct] = getattr(module, f"{name.title().replace('_', '')}Config")
    return load(kind, name, file, overrides, environment)


def check(service: Service, settings: msgspec.Struct) -> None:
    """Check files, models and sources that the settings of a service name.

    Raises:
        People4dError: One is missing or unusable.
    """
    if location := service.labels.get("people4d.check"):
        _find(location)(settings)


def load_model(service: Service, settings: msgspec.Struct) -> str:
    """Load the model of a service and return its name; empty if the service has none.

    Raises:
        People4dError: The model is missing, altered or cannot be loaded.
    """
    location = service.labels.get("people4d.model")
    if not location:
        return ""
    _find(location)(settings)
    fields = msgspec.structs.asdict(settings)
    return str(fields.get("model") or fields.get("embedder"))


def _find(location: str) -> Callable[[Any], object]:
    module, _, name = location.partition(":")
    found: Callable[[Any], object] = getattr(importlib.import_module(module), name)
    return found
