"""Configuration from file, environment and command line."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import msgspec
import pytest

from common.config import load
from people4d.errors import ConfigError


class Gate(msgspec.Struct, frozen=True, kw_only=True):
    distance_m: float = 1.5
    method: Literal["mean", "median"] = "mean"


class Tracker(msgspec.Struct, frozen=True, kw_only=True):
    min_hits: int = 3
    name: str = "sort3d"
    frame: str | None = None
    fast: bool = False
    weights: tuple[float, ...] = ()
    gate: Gate = Gate()

    def __post_init__(self) -> None:
        if self.min_hits < 1:
            raise ValueError(f"min_hits: expected >= 1, got {self.min_hits}")


def of(
    *overrides: str, file: Path | None = None, environment: Mapping[str, str] | None = None
) -> Tracker:
    return load(Tracker, "tracker", file, overrides, environment or {})


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "people4d.toml"
    path.write_text(
        '[tracker]\nmin_hits = 4\nname = "a"\nweights = [1, 2.5]\n'
        "gate.distance_m = 2\n[reid]\nx = 1\n"
    )
    return path


def test_absent_fields_have_their_defaults(file: Path) -> None:
    assert of() == Tracker()
    assert load(Tracker, "absent", file, (), {}) == Tracker()


def test_overrides_win_over_environment_and_environment_over_file(file: Path) -> None:
    environment = {"PEOPLE4D_TRACKER_MIN_HITS": "5", "PEOPLE4D_TRACKER_NAME": "b"}
    assert of(file=file).min_hits == 4
    assert of(file=file, environment=environment).min_hits == 5
    both = of("min_hits=6", file=file, environment=environment)
    assert (both.min_hits, both.name, both.weights) == (6, "b", (1.0, 2.5))
    assert both.gate.distance_m == 2.0


def test_an_empty_variable_counts_as_not_set(file: Path) -> None:
    assert of(file=file, environment={"PEOPLE4D_TRACKER_MIN_HITS": ""}).min_hits == 4


@pytest.mark.parametrize(
    ("override", "field", "value"),
    [
        ("min_hits=7", "min_hits", 7),
        ("fast=true", "fast", True),
        ("weights=[1, 2]", "weights", (1.0, 2.0)),
        ("gate.distance_m=1e-1", "gate", Gate(distance_m=0.1)),
        (" gate.method = 'median'", "gate", Gate(method="median")),
        ("name=plain words", "name", "plain words"),
        ("name='quoted'", "name", "quoted"),
        ("name=a=b", "name", "a=b"),
        # Text that looks like a number or a date remains text.
        ("name=0", "name", "0"),
        ("name=1.0", "name", "1.0"),
        ("frame=2026-01-31", "frame", "2026-01-31"),
    ],
)
def test_values_on_the_command_line(override: str, field: str, value: object) -> None:
    assert getattr(of(override), field) == value


def test_a_table_in_one_setting_and_one_field_of_it_in_another() -> None:
    assert of("gate={distance_m=3}", "gate.method=median").gate == Gate(
        distance_m=3.0, method="median"
    )


@pytest.mark.parametrize(
    ("override", "problem"),
    [
        ("min_hit=3", "configuration of tracker has no field 'min_hit'. Did you mean min_hits?"),
        ("zzz=3", "has no field 'zzz'. Its fields are min_hits, name, frame, fast, weights, gate."),
        # A misspelt field of a table must be an error.
        ("gate.distance=3", "tracker.gate has no field 'distance'. Did you mean distance_m?"),
        ("min_hits=3.5", "configuration of tracker.min_hits: expected `int`, got `float`"),
        ("min_hits=many", "configuration of tracker.min_hits: expected `int`, got `str`"),
        ("gate.distance_m=[1]", "tracker.gate.distance_m: expected `float`, got `array`"),
        ("gate.method=mode", "configuration of tracker.gate.method: invalid enum value 'mode'"),
        ("gate=3", "configuration of tracker.gate: expected `object`, got `int`"),
        ("min_hits=0", "configuration of tracker.min_hits: expected >= 1, got 0"),
        ("min_hits", "setting 'min_hits' has no value. Write field=value."),
        ("name.more=3", "configuration of tracker.name: expected `str`, got `object`"),
    ],
)
def test_a_bad_setting_is_refused_with_a_hint(override: str, problem: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(problem)):
        of(override)


def test_a_setting_below_a_value_is_refused(file: Path) -> None:
    with pytest.raises(ConfigError, match=r"setting name\.more: name is not a table"):
        of("name.more=3", file=file)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"[tracker\n", "is not TOML: "),
        (b"\xff\xfe", "is not TOML: "),
        (b"tracker = 3\n", "[tracker] is not a table"),
        (b"[tracker]\nmin_hits = '4x'\n", "configuration of tracker.min_hits: expected `int`"),
        (b"[tracker]\ngate = { far = 1 }\n", "configuration of tracker.gate has no field 'far'"),
    ],
)
def test_a_bad_file_is_reported(tmp_path: Path, content: bytes, problem: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=re.escape(problem)):
        of(file=path)


def test_an_absent_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.toml cannot be read: No such file"):
        of(file=tmp_path / "none.toml")


@pytest.mark.parametrize(
    "text",
    [
        "[tracker]\nname = " + "[" * 5000,
        "[tracker" + ".a" * 3000 + "]",
        "[tracker]\nmin_hits = " + "9" * 5000,
        "[tracker]\ngate.distance_m = " + "9" * 400,
        "[tracker]\n" + "x" * 500_000 + " = 1",
        "#" * 2**20 + "\n",
    ],
    ids=["lists", "tables", "digits", "number", "name", "size"],
)
def test_a_hostile_file_is_refused_in_a_short_sentence(text: str, tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        of(file=path)
    assert len(str(caught.value)) < 1000


def test_a_hostile_override_is_refused_too() -> None:
    with pytest.raises(ConfigError, match="expected `int`"):
        of("min_hits=" + "[" * 5000)
