"""Files: size limits and folder checks of untrusted files, atomic replacement of own files."""

import errno
import os
import tomllib
from pathlib import Path
from typing import Any

import yaml

MAX_TEXT_BYTES = 2**20  # maximum size of a configuration, a calibration, a list of settings
MAX_CHARACTERS = 2**18  # maximum length of YAML
MAX_DEPTH = 32  # maximum depth of nested lists and maps

# libyaml's loader, if installed, is fast and does not recurse.
EVENTS: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def read_bytes(path: Path, limit: int) -> bytes:
    """Read a file into memory; OSError if it cannot be read or has more bytes than the limit."""
    with path.open("rb") as file:
        # The reported size may be wrong; the size of a pipe is 0.
        data = file.read(min(limit, os.fstat(file.fileno()).st_size) + 1)
        while len(data) <= limit and (more := file.read(limit + 1 - len(data))):
            data += more
    if len(data) > limit:
        raise OSError(errno.EFBIG, f"it is larger than {limit} bytes", str(path))
    return data


def read_text(path: Path, limit: int = MAX_TEXT_BYTES) -> str:
    """Read a file as UTF-8; OSError as in `read_bytes`, ValueError if it is no UTF-8."""
    return read_bytes(path, limit).decode("utf-8-sig")


def write_private(path: Path, content: bytes) -> None:
    """Replace a file by one readable only by its owner, as `replace_file`; create its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, content, 0o600)


def replace_file(path: Path, content: bytes, mode: int = 0o666) -> None:
    """Replace a file atomically by one with a mode, less the process's mask; or OSError."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, mode)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except OSError:
        part.unlink(missing_ok=True)
        raise


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file; OSError as in `read_bytes`, ValueError as in `parse_toml`."""
    return parse_toml(read_text(path))


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML; ValueError if it is invalid, or if lists and tables are nested too deeply."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("lists or tables are nested too deeply") from None


def inside(folder: Path, name: str) -> Path:
    """Return a path in a folder by an untrusted name; ValueError if it leaves the folder."""
    if "\0" in name or not name.strip():
        raise ValueError(f"expected the name of a file, got {name!r:.80}")
    path = folder / name
    try:
        resolved = path.resolve()
    except (OSError, RuntimeError) as error:  # a loop of links
        raise ValueError(f"{name!r:.80} cannot be followed: {error}") from error
    if not resolved.is_relative_to(folder.resolve()):
        raise ValueError(f"{name!r:.80} leads out of the folder {folder}")
    return path


def parse_yaml(text: str) -> Any:
    """Parse YAML; ValueError if it is too long, too deep, or has aliases, which may expand."""
    if len(text) > MAX_CHARACTERS:
        raise ValueError(f"it is longer than {MAX_CHARACTERS} characters")
    depth = 0
    try:
        for event in yaml.parse(text, EVENTS):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_DEPTH:
                raise ValueError("lists or maps are nested too deeply")
            if isinstance(event, yaml.AliasEvent):
                raise ValueError("it has aliases (*), which are not supported")
        return yaml.load(text, EVENTS)
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())[:200]) from error
