"""Configuration: a typed record per service, from TOML file, environment and command line."""

import difflib
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

import msgspec

from common.io.files import parse_toml, read_toml
from people4d.errors import ConfigError
from people4d.validation import check, explain

T = TypeVar("T", bound=msgspec.Struct)

MAX_NAME = 80  # maximum length of an unknown name in errors


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """Base of configuration records: every field is checked against its annotation.

    Ranges are types of `people4d.messages.base`, for example Positive or Ratio. A `float` is finite
    unless it is annotated INFINITE.
    """

    def __post_init__(self) -> None:
        """Check the fields; ValueError if a value is out of range or not finite."""
        check(self)


def load(
    kind: type[T],
    section: str,
    file: Path | None = None,
    overrides: Sequence[str] = (),
    environment: Mapping[str, str] = os.environ,
) -> T:
    """Build a configuration record; later sources win: file, environment, overrides.

    ConfigError if a field is unknown, or a value has the wrong type or is out of range.

    Args:
        kind: Record type; its defaults hold for absent fields.
        section: Table of the TOML file and name in the environment: PEOPLE4D_<SECTION>_<FIELD>.
        file: TOML file, None for none.
        overrides: "field=value" or "table.field=value" as given on the command line.
        environment: Environment variables; an empty value counts as not set.
    """
    values = _read(file, section) if file else {}
    for name in kind.__struct_fields__:
        value = environment.get(f"PEOPLE4D_{section}_{name}".upper(), "")
        if value:
            values[name] = _parse(value, _hint(kind, [name]))
    for override in overrides:
        name, separator, value = override.partition("=")
        if not separator:
            raise ConfigError(f"setting {override!r} has no value", "Write field=value.")
        path = name.strip().split(".")
        _put(values, path, _parse(value, _hint(kind, path)))
    _check_names(kind, section, values)
    try:
        return msgspec.convert(values, kind, strict=False)
    except RecursionError:
        raise ConfigError(f"configuration of {section} is nested too deeply") from None
    except (msgspec.ValidationError, ConfigError) as error:
        problem = explain(error, values, section)
        raise ConfigError(f"configuration of {problem:.600}") from error


def _read(file: Path, section: str) -> dict[str, Any]:
    try:
        tables = read_toml(file)
    except OSError as error:
        raise ConfigError(f"configuration file {file} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(f"configuration file {file} is not TOML: {error}") from error
    table = tables.get(section, {})
    if not isinstance(table, dict):
        raise ConfigError(f"configuration file {file}: [{section}] is not a table")
    return table


def _parse(text: str, hint: Any) -> Any:
    """Read a value as TOML if possible (numbers, lists, tables), else as plain text."""
    try:
        value = parse_toml(f"value = {text}")["value"]
    except ValueError:
        return text
    # Text fields keep the value as written, since a camera may be named 0 or a folder like a date.
    reads_text = hint is str or str in get_args(hint)
    return text if reads_text and not isinstance(value, str | list) else value


def _hint(kind: Any, path: Sequence[str]) -> Any:
    """Return the type of the field at a path, None if there is none."""
    for name in path:
        table = _table(kind)
        kind = get_type_hints(table).get(name) if table else None
    return kind


def _table(hint: Any) -> type[msgspec.Struct] | None:
    """Return the record type of a table field."""
    for kind in (hint, *get_args(hint)):
        if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
            return kind
    return None


def _put(values: dict[str, Any], path: list[str], value: Any) -> None:
    for name in path[:-1]:
        below = values.setdefault(name, {})
        if not isinstance(below, dict):
            raise ConfigError(f"setting {'.'.join(path)}: {name} is not a table")
        values = below
    values[path[-1]] = value


def _check_names(kind: type[msgspec.Struct], section: str, values: Mapping[str, Any]) -> None:
    for name, value in values.items():
        if name not in kind.__struct_fields__:
            near = difflib.get_close_matches(name[:MAX_NAME], kind.__struct_fields__, 1)
            hint = f"Did you mean {near[0]}?" if near else ""
            fields = ", ".join(kind.__struct_fields__) or "none"
            raise ConfigError(
                f"configuration of {section} has no field {name[:MAX_NAME]!r}",
                hint or f"Its fields are {fields}.",
            )
        below = _table(_hint(kind, [name]))
        if below and isinstance(value, dict):
            _check_names(below, f"{section}.{name}", value)


def setting(name: str, text: str) -> str:
    """Return a setting as text; its value stays text even if it resembles a number."""
    # A JSON string without escapes above ASCII is a TOML string.
    return f"{name}={json.dumps(text, ensure_ascii=False)}"
