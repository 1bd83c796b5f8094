"""Packages of the extras of people4d-robot, checked before the work that needs them."""

import importlib.util
import sys

from people4d.errors import ConfigError

MODULES = {  # top-level modules by extra
    "dashboard": ("anyio", "starlette", "uvicorn", "websockets"),
    "dds": ("cyclonedds",),
    "evaluate": ("matplotlib",),
    "foxglove": ("foxglove",),
    "keys": ("cryptography",),
    "mqtt": ("paho",),
    "oak": ("depthai",),
    "openvino": ("openvino",),
    "orbbec": ("pyorbbecsdk",),
    "otel": ("opentelemetry",),
    "parquet": ("pyarrow",),
    "prometheus": ("prometheus_client",),
    "quantize": ("onnx",),
    "realsense": ("pyrealsense2",),
    "rerun": ("rerun",),
    "tune": ("optuna",),
}


def need(what: str, extra: str) -> None:
    """Check that an extra is installed; ConfigError if a package needed by `what` is missing."""
    absent = missing(extra)
    if absent:
        raise ConfigError(f"{what} needs {absent}, which is not installed", install(extra))


def missing(extra: str) -> str:
    """Return a missing module of an extra; empty if all are installed."""
    return next((name for name in MODULES[extra] if importlib.util.find_spec(name) is None), "")


def install(extra: str) -> str:
    """Return the remedy for a missing extra: the command that installs it here."""
    return f"Install it: {sys.executable} -m pip install 'people4d-robot[{extra}]'"
