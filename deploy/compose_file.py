"""Compose files as documents: YAML with `extends`, `!reset`, `!override` and variables.

Docker compose reads the same files. Merges follow its rules: maps are merged by field, lists are
appended, and commands are replaced.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from people4d.errors import ConfigError

VARIABLE = re.compile(
    r"\$(?:(?P<escaped>\$)|\{(?P<name>[A-Za-z_]\w*)(?::(?P<rule>[-?])(?P<word>[^${}]*))?\}|(?P<bad>))"
)
REPLACED = ("command", "entrypoint", "test")  # lists that are replaced
MAX_DEPTH = 8  # maximum length of a chain of extensions


@dataclass(frozen=True)
class _Override:
    """Value that replaces the extended value; None removes the field."""

    value: Any


class _Loader(yaml.SafeLoader):
    """YAML of compose files, with their two tags."""


def _construct_override(loader: _Loader, node: yaml.Node) -> _Override:
    if isinstance(node, yaml.MappingNode):
        return _Override(loader.construct_mapping(node, deep=True))
    if isinstance(node, yaml.SequenceNode):
        return _Override(loader.construct_sequence(node, deep=True))
    return _Override(None)


_Loader.add_constructor("!override", _construct_override)
_Loader.add_constructor("!reset", lambda *_: _Override(None))


def load(file: Path) -> Any:
    """Load a compose file, with extended services merged.

    ConfigError if a file cannot be read or is not YAML; ValueError if a service extends itself or
    an unknown service.
    """
    parse = cache(_parse)
    document = parse(file)
    if not isinstance(document, dict) or not isinstance(document.get("services"), dict):
        return document
    services = {name: _service(parse, file, name, MAX_DEPTH) for name in document["services"]}
    return document | {"services": services}


def interpolate(value: Any, variables: Mapping[str, str]) -> Any:
    """Expand ${VAR}, ${VAR:-default}, ${VAR:?error} and $$ in all strings of a value.

    ValueError if a required variable is missing or an expression is invalid.
    """
    if isinstance(value, str):
        return VARIABLE.sub(lambda match: _fill(match, variables), value)
    if isinstance(value, list):
        return [interpolate(item, variables) for item in value]
    if isinstance(value, dict):
        return {key: interpolate(item, variables) for key, item in value.items()}
    return value


def merge(base: Any, own: Any, field: str = "") -> Any:
    """Merge a value into the value of the extended service."""
    if isinstance(own, _Override):
        return own.value
    if isinstance(base, dict) and isinstance(own, dict):
        merged = base | {name: merge(base.get(name), value, name) for name, value in own.items()}
        removed = {n for n, v in own.items() if isinstance(v, _Override) and v.value is None}
        return {name: value for name, value in merged.items() if name not in removed}
    if isinstance(base, list) and isinstance(own, list) and field not in REPLACED:
        return base + [item for item in own if item not in base]
    return own


def _service(parse: Callable[[Path], Any], file: Path, name: Any, depth: int) -> Any:
    document = parse(file)
    services = document.get("services") if isinstance(document, dict) else None
    if not isinstance(services, dict) or name not in services:
        raise ValueError(f"{file} has no service {name!r} to extend")
    own = services[name]
    extended = own.get("extends") if isinstance(own, dict) else None
    if extended is None:
        return merge({}, own) if isinstance(own, dict) else own
    if not isinstance(extended, dict) or not isinstance(extended.get("service"), str) or not depth:
        raise ValueError(f"{name}.extends: expected a file and a service, got {extended!r:.80}")
    other = file.parent / str(extended.get("file", file.name))
    base = _service(parse, other, extended["service"], depth - 1)
    return merge(base, {field: value for field, value in own.items() if field != "extends"})


def _parse(file: Path) -> Any:
    try:
        return yaml.load(file.read_text(encoding="utf-8"), Loader=_Loader)
    except OSError as error:
        raise ConfigError(f"compose file {file} cannot be read: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"compose file {file} is not YAML: {error}") from error


def _fill(match: re.Match[str], variables: Mapping[str, str]) -> str:
    if match["escaped"]:
        return "$"
    name, rule, word = match["name"], match["rule"], match["word"]
    if not name:
        raise ValueError(f"{match.string!r}: expected $$, ${{NAME}} or ${{NAME:-default}}")
    value = variables.get(name, "")
    if rule == "?" and not value:
        raise ValueError(f"variable {name} is not set: {word}")
    return value or word or ""
