"""Cache of slow results, with keys from all inputs."""

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType

import msgspec

import people4d
import services.camera
import services.detector
import services.reid
from common import compiled, config, geometry, inference, io, registry
from common.io import weights
from people4d.errors import SourceError
from services.detector.config import DetectorConfig
from services.reid.config import ReidConfig

SHARED_CODE = (people4d, compiled, config, inference, registry, geometry, io, services.camera)
DETECTOR_CODE = (*SHARED_CODE, services.detector)
REID_CODE = (*DETECTOR_CODE, services.reid)
BLOCK_BYTES = 2**20


def default_folder() -> Path:
    """Return the default folder of the cache."""
    base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "people4d" / "evaluation"


def key_of(*parts: object) -> str:
    """Return a name for a result that depends on records, texts and numbers."""
    return hashlib.sha256(msgspec.json.encode(parts)).hexdigest()[:32]


def code_digest(modules: Iterable[ModuleType]) -> str:
    """Return a digest of the Python files of modules and packages."""
    digests = []
    for module in modules:
        file = Path(module.__file__ or "")
        package = file.name == "__init__.py"
        files = sorted(file.parent.rglob("*.py")) if package else [file]
        digests.append(_digest(files, file.parent))
    return key_of(digests)


def content_digest(path: Path) -> str:
    """Return a digest of a recording, file or folder; SourceError if it cannot be read."""
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    try:
        return _digest(files, path.parent)
    except OSError as error:
        raise SourceError(f"recording {path} cannot be read: {error.strerror}") from error


def model_digests(config: DetectorConfig | ReidConfig) -> tuple[str, ...]:
    """Return the checksums of the files of configured models, the people model first.

    ModelError if a model is unknown, or its file is absent.
    """
    if isinstance(config, ReidConfig):
        models = [config.network]
    else:
        models = [config.model, config.orientation_network, config.body_network]
    return tuple(_model_digest(model, config.folder) for model in models if model)


def _model_digest(model: str, folder: str) -> str:
    path, entry = weights.locate(model, folder)
    return entry.sha256 if entry else weights.checksum(path)


def _digest(files: Iterable[Path], root: Path) -> str:
    digest = hashlib.sha256()
    for path in files:
        digest.update(f"{path.relative_to(root)} {path.stat().st_size}\n".encode())
        with path.open("rb") as file:
            while block := file.read(BLOCK_BYTES):
                digest.update(block)
    return digest.hexdigest()
