"""Configuration: a typed record per service, from TOML file, environment and command line."""

import difflib
import os
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from common.errors import ConfigError

T = TypeVar("T", bound=msgspec.Struct)


def load(
    kind: type[T],
    section: str,
    file: Path | None = None,
    overrides: Sequence[str] = (),
    environment: Mapping[str, str] = os.environ,
) -> T:
    """Build a configuration record; later sources win: file, environment, overrides.

    Args:
        kind: Record type; its defaults hold where nothing is said.
        section: Table of the TOML file and name in the environment: PEOPLE4D_<SECTION>_<FIELD>.
        file: TOML file, None for none.
        overrides: "field=value" or "table.field=value" as given on the command line.
        environment: Environment variables; an empty value counts as not set.

    Raises:
        ConfigError: A field is unknown, or a value has the wrong type or is out of range.
    """
    values = _read(file, section) if file else {}
    for name in kind.__struct_fields__:
        value = environment.get(f"PEOPLE4D_{section}_{name}".upper(), "")
        if value:
            values[name] = _parse(value)
    for override in overrides:
        path, separator, value = override.partition("=")
        if not separator:
            raise ConfigError(f"setting {override!r} has no value", "Write field=value.")
        _put(values, path.strip().split("."), _parse(value))
    _check_names(kind, section, values)
    try:
        return msgspec.convert(values, kind, strict=False)
    except (msgspec.ValidationError, ConfigError) as error:
        raise ConfigError(f"configuration of {section}: {error}") from error


def _read(file: Path, section: str) -> dict[str, Any]:
    try:
        text = file.read_text(encoding="utf-8")
        tables = tomllib.loads(text)
    except OSError as error:
        raise ConfigError(f"configuration file {file} cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"configuration file {file} is not TOML: {error}") from error
    table = tables.get(section, {})
    if not isinstance(table, dict):
        raise ConfigError(f"configuration file {file}: [{section}] is not a table")
    return table


def _parse(text: str) -> Any:
    """Read a value as TOML where it is one (numbers, lists, tables), else as plain text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _put(values: dict[str, Any], path: list[str], value: Any) -> None:
    for name in path[:-1]:
        below = values.setdefault(name, {})
        if not isinstance(below, dict):
            raise ConfigError(f"setting {'.'.join(path)}: {name} is not a table")
        values = below
    values[path[-1]] = value


def _check_names(kind: type[msgspec.Struct], section: str, values: Mapping[str, Any]) -> None:
    for name in values:
        if name not in kind.__struct_fields__:
            near = difflib.get_close_matches(name, kind.__struct_fields__, 1)
            mend = f"Did you mean {near[0]}?" if near else ""
            fields = ", ".join(kind.__struct_fields__)
            raise ConfigError(
                f"configuration of {section} has no field {name!r}",
                mend or f"Its fields are {fields}.",
            )
