"""What took long is kept, under a name that tells everything it depends on."""

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

import msgspec

from common.io import weights
from people4d.errors import SourceError
from services.detector.config import DetectorConfig
from services.reid.config import ReidConfig

ROOT = Path(__file__).resolve().parents[1]
CODE = (
    *("people4d/**/*.py", "common/*.py", "common/geometry/*.py", "common/io/*.py"),
    *("services/camera/**/*.py", "services/detector/**/*.py"),
)
REID_CODE = (*CODE, "services/reid/**/*.py")
BLOCK_BYTES = 2**20


def default_folder() -> Path:
    """Return where things are kept unless told otherwise."""
    base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "people4d" / "evaluation"


def key_of(*parts: object) -> str:
    """Return a name for what depends on records, texts and numbers."""
    return hashlib.sha256(msgspec.json.encode(parts)).hexdigest()[:32]


def code_digest(patterns: Iterable[str]) -> str:
    """Return what tells the code of some folders from any other version of it."""
    files = sorted({path for pattern in patterns for path in ROOT.glob(pattern)})
    return _digest(files, ROOT)


def content_digest(path: Path) -> str:
    """Return what tells a recording, or a folder of one, from any other.

    Raises:
        SourceError: It cannot be read.
    """
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    try:
        return _digest(files, path.parent)
    except OSError as error:
        raise SourceError(f"recording {path} cannot be read: {error.strerror}") from error


def model_digest(config: DetectorConfig | ReidConfig) -> str:
    """Return the checksum of a configured model's file.

    Raises:
        ModelError: The model is unknown, or its file is absent.
    """
    if isinstance(config, ReidConfig) and config.embedder != "osnet":
        return ""  # it has no file
    if Path(config.model).suffix == ".onnx":
        return weights.checksum(Path(config.model).expanduser())
    model = weights.choose(config.model, weights.load_manifest())
    return weights.checksum(weights.find(model, weights.folders(config.folder)))


def _digest(files: Iterable[Path], root: Path) -> str:
    digest = hashlib.sha256()
    for path in files:
        digest.update(f"{path.relative_to(root)} {path.stat().st_size}\n".encode())
        with path.open("rb") as file:
            while block := file.read(BLOCK_BYTES):
                digest.update(block)
    return digest.hexdigest()
