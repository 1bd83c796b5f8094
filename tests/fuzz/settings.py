"""Readers of settings: configuration, models.toml, presets, scenarios."""

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import get_type_hints

import msgspec

from common.config import load
from common.io import weights
from lab.catalogue import load_scenario
from people4d.errors import People4dError
from services.presets import FOLDER, preset_settings
from tests import ROOT
from tests.fuzz.target import Target

SERVICES = (
    *("camera", "detector", "reid", "tracker", "gait", "visual_odometry", "predictor", "gt_bridge"),
    *("skeleton", "ros2_bridge", "report", "dashboard", "events", "site"),
)
CONFIG = ROOT / "deploy" / "config" / "people4d.toml"


def _records() -> dict[str, type[msgspec.Struct]]:
    records = {}
    for name in SERVICES:
        build = importlib.import_module(f"services.{name}.build").build
        records[name] = get_type_hints(build)["config"]
    return records


RECORDS = _records()


def _config(data: bytes, folder: Path) -> None:
    path = folder / "a.toml"
    path.write_bytes(data)
    text = data.decode("utf-8", "replace")
    for name, record in RECORDS.items():
        for file, overrides in ((path, ()), (None, [text[:200]])):
            try:
                load(record, name, file, overrides, {})
            except People4dError:
                continue


def _config_seeds(_: Path) -> Sequence[bytes]:
    plain = [
        f"[{name}]\n" + "\n".join(f"{field} = 1" for field in record.__struct_fields__)
        for name, record in RECORDS.items()
    ]
    return [CONFIG.read_bytes(), *(text.encode() for text in plain), b"tracker.a.b=[1, 2]"]


def _models(data: bytes, folder: Path) -> None:
    path = folder / "models.toml"
    path.write_bytes(data)
    for model in weights.load_manifest(path).values():
        try:
            found = weights.find(model, [folder])
        except People4dError:
            continue
        if found.parent != folder:
            raise AssertionError("a model lies outside of its folder")


def _preset(data: bytes, folder: Path) -> None:
    path = folder / "mine.toml"
    path.write_bytes(data)
    for text in preset_settings(str(path)):
        service, _, setting = text.partition(".")
        if "\n" in text.partition("=")[0]:
            raise AssertionError("a setting breaks its line")
        if service in RECORDS:
            try:
                load(RECORDS[service], service, None, [setting], {})
            except People4dError:
                continue


def _preset_seeds(_: Path) -> Sequence[bytes]:
    return [file.read_bytes() for file in sorted(FOLDER.glob("*.toml"))]


def _scenario(data: bytes, folder: Path) -> None:
    path = folder / "a.toml"
    path.write_bytes(data)
    load_scenario(str(path))


def _scenario_seeds(_: Path) -> Sequence[bytes]:
    folder = Path(importlib.import_module("lab").__path__[0]) / "scenarios"
    return [file.read_bytes() for file in sorted(folder.glob("*.toml"))[:6]]


WORDS = (b"inf", b"nan", b"1e999", b"[[", b"]]", b'"""', b"'''", b"\\u0000", b"1979-05-27")

TARGETS = (
    Target("configuration", _config, _config_seeds, (*WORDS, b"tracker", b"camera"), 8192),
    Target(
        "models.toml",
        _models,
        lambda _: [weights.MANIFEST.read_bytes()],
        (*WORDS, b"../", b"sha256", b"file"),
        8192,
    ),
    Target("preset", _preset, _preset_seeds, (*WORDS, b"extends", b"mine.toml", b"../"), 8192),
    Target("scenario of the lab", _scenario, _scenario_seeds, WORDS, 8192),
)
