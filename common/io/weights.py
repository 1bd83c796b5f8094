"""Model files: manifest, folders and checksums."""

import difflib
import hashlib
import json
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import msgspec

from common.config import Config
from common.io.files import read_toml
from people4d.errors import ConfigError, ModelError
from people4d.messages.base import Positive
from people4d.validation import Rule

REPOSITORY = Path(__file__).resolve().parents[2]
MANIFEST = REPOSITORY / "models" / "models.toml"
HOME_FOLDER = Path("~/.local/share/people4d/models")
FILE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
SHA256 = re.compile(r"([0-9a-f]{64})?")


def _is_printable(text: str) -> bool:
    return text.replace("\n", " ").isprintable()


# Control characters would reach the terminal that lists models.
Printable = Annotated[str, Rule("text that can be printed", _is_printable)]


class ModelFile(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One model of the manifest."""

    name: Printable  # name in configurations
    # Detector: movenet, yolov8-pose, yolov8-seg, yolo-boxes, rtmo, rtmpose, orientation;
    # re-identification: appearance, osnet
    kind: Printable
    # Name in one of the model folders
    file: Annotated[str, Rule("a plain file name", lambda name: bool(FILE_NAME.fullmatch(name)))]
    licence: Printable  # licence of the weights, as their source states it
    input: Printable  # shape, range and colour order of the input
    get: Printable  # instructions for obtaining the file, including commands
    url: Printable = ""  # page of the source; empty: none
    score_scale: Positive = 1.0  # factor of its scores relative to other models of its kind
    # Checksum of the file; empty: exports differ, so any file is accepted
    sha256: Annotated[str, Rule("64 hexadecimal digits", lambda t: bool(SHA256.fullmatch(t)))] = ""


def load_manifest(path: Path = MANIFEST) -> dict[str, ModelFile]:
    """Read a manifest (TOML) as models by name, in its order; ConfigError if it is invalid."""
    try:
        tables = read_toml(path)
    except OSError as error:
        raise ConfigError(f"model manifest {path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(f"model manifest {path} is not TOML: {error}") from error
    models = {}
    for name, table in tables.items():
        try:
            models[name] = msgspec.convert({"name": name} | table, ModelFile)
        except (TypeError, RecursionError, msgspec.ValidationError) as error:
            raise ConfigError(f"model manifest {path}: [{name:.80}]: {error}") from error
    return models


def known_models() -> dict[str, ModelFile]:
    """Return the shipped manifest and the user's own models; ConfigError if one is invalid."""
    own = own_folder() / MANIFEST.name
    return load_manifest() | (load_manifest(own) if own.is_file() else {})


def own_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """Return the folder of the user's own models and of their manifest."""
    return Path(environment.get("PEOPLE4D_MODELS") or HOME_FOLDER).expanduser()


def write_manifest(path: Path, models: Mapping[str, ModelFile]) -> None:
    """Write a manifest (TOML) that `load_manifest` reads."""
    tables = []
    for model in models.values():
        fields = msgspec.to_builtins(model)
        name = json.dumps(fields.pop("name"), ensure_ascii=False)
        lines = (f"{key} = {json.dumps(v, ensure_ascii=False)}" for key, v in fields.items())
        tables.append("\n".join([f"[{name}]", *lines, ""]))
    path.write_text("\n".join(tables), encoding="utf-8")


def choose(name: str, manifest: Mapping[str, ModelFile]) -> ModelFile:
    """Return the model of a name; ModelError if the manifest has none."""
    if name not in manifest:
        near = difflib.get_close_matches(name, manifest, 1)
        hint = f"Did you mean {near[0]}?" if near else f"Choose {', '.join(manifest)}."
        raise ModelError(f"model {name!r} is unknown", f"{hint} Or give the path of an .onnx file.")
    return manifest[name]


def folders(configured: str = "", environment: Mapping[str, str] = os.environ) -> tuple[Path, ...]:
    """Return the search folders of models: configured, of PEOPLE4D_MODELS, then the others."""
    named = (configured, environment.get("PEOPLE4D_MODELS", ""))
    own = [Path(folder).expanduser() for folder in named if folder]
    return (*own, REPOSITORY / "models", HOME_FOLDER.expanduser())


def find(model: ModelFile, searched: Sequence[Path]) -> Path:
    """Return the path of a model's file in the first folder with it; or raise ModelError."""
    for folder in searched:
        path = folder / model.file
        if path.is_file():
            return path
    names = ", ".join(map(str, searched))
    raise ModelError(f"model {model.name}: {model.file} was not found in {names}", model.get)


def locate(model: str, folder: str = "") -> tuple[Path, ModelFile | None]:
    """Return the file of a model, its checksum verified, and its entry in the manifest.

    ModelError if the model is unknown, absent or altered.

    Args:
        model: Name in the manifest, or path of an .onnx file, which has no entry.
        folder: Folder named in a configuration; empty for none.
    """
    path = Path(model).expanduser()
    if path.suffix == ".onnx":
        if not path.is_file():
            raise ModelError(f"model file {path} does not exist", "Check the path.")
        return path, None
    entry = choose(model, known_models())
    path = find(entry, folders(folder))
    verify(path, entry.sha256)
    return path, entry


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal; ModelError if it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise ModelError(f"model file {path} cannot be read: {error.strerror}") from error


def verify(path: Path, sha256: str) -> None:
    """Raise ModelError if the checksum of a file differs from `sha256`; empty: no check."""
    if not sha256:
        return
    got = checksum(path)
    if got != sha256:
        raise ModelError(
            f"model file {path}: expected sha256 {sha256}, got {got}",
            "It is truncated or altered: remove it and get it again, see people4d models.",
        )
