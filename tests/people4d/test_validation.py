"""Checks of records by the annotations of their fields."""

import math
import re
from typing import Annotated, Any

import msgspec
import numpy as np
import pytest
from msgspec import Meta

from common.config import Config, load
from people4d.errors import ConfigError
from people4d.messages import F64
from people4d.messages.base import (
    Count,
    Name,
    NameOrEmpty,
    NonNegative,
    Positive,
    PositiveOrInfinite,
    Ratio,
    Record,
    Text,
)
from people4d.validation import Rule, Shape


class Ranges(Record, frozen=True, kw_only=True):
    positive: Positive = 1.0
    optional: NonNegative | None = None
    bare: float = 0.0
    infinite: PositiveOrInfinite = math.inf
    half_open: Annotated[float, Meta(ge=0, lt=1)] = 0.0
    count: Count = 0
    ratios: tuple[Ratio, ...] = ()
    pair: tuple[float, float] = (0.0, 0.0)
    rates: dict[Name, Positive] = msgspec.field(default_factory=dict)
    three: Annotated[tuple[int, ...], Meta(min_length=1, max_length=3)] = (1,)
    points: Annotated[F64, Shape("N", 3)] | None = None
    name: NameOrEmpty = ""
    text: Text = ""
    even: Annotated[int, Rule("an even number", lambda n: n % 2 == 0)] = 0
    mixed: int | str = "anything"


GOOD: list[dict[str, Any]] = [
    {},
    {"positive": 5e-324, "half_open": 0, "count": 10**30},
    {"positive": np.float32(0.5), "count": np.int64(3)},
    {"points": np.zeros((0, 3)), "ratios": (0.0, 1.0), "rates": {"a": 1.0}, "name": "a"},
]
BAD: list[tuple[dict[str, Any], str]] = [
    ({"positive": 0.0}, "positive: expected a finite number > 0, got 0.0"),
    ({"positive": np.float32(0)}, "positive: expected a finite number > 0, got "),
    ({"positive": math.inf}, "positive: expected a finite number > 0, got inf"),
    ({"optional": -1e-9}, "optional: expected a finite number >= 0, got -1e-09"),
    ({"bare": math.nan}, "bare: expected a finite number, got nan"),
    ({"infinite": math.nan}, "infinite: expected > 0, got nan"),
    ({"half_open": 1.0}, "half_open: expected a finite number >= 0 and < 1, got 1.0"),
    ({"count": -1}, "count: expected >= 0, got -1"),
    ({"ratios": (0.5, 1.5)}, "ratios: expected 0 to 1, got 1.5"),
    ({"pair": (0.0, math.inf)}, "pair: expected a finite number, got inf"),
    ({"rates": {"a": 1.0, "b": -1.0}}, "rates: expected a finite number > 0, got -1.0"),
    ({"rates": {"a/b": 1.0}}, "rates: expected 1 to 64 characters from A-Z"),
    ({"three": ()}, "three: expected at least 1 elements, got 0"),
    ({"three": (1, 2, 3, 4)}, "three: expected at most 3 elements, got 4"),
    ({"points": np.zeros((2, 2))}, "points: expected shape Nx3, got 2x2"),
    ({"points": np.zeros(3)}, "points: expected shape Nx3, got 3"),
    ({"points": np.full((1, 3), np.nan)}, "points: expected finite numbers, got NaN or infinity"),
    ({"name": "-a"}, "name: expected 1 to 64 characters from"),
    ({"text": "\x1b"}, "text: expected printable text, got"),
    ({"even": 3}, "even: expected an even number, got 3"),
]


@pytest.mark.parametrize("fields", GOOD)
def test_values_in_range_pass(fields: dict[str, Any]) -> None:
    Ranges(**fields)


@pytest.mark.parametrize(("fields", "problem"), BAD)
def test_a_value_out_of_range_is_refused(fields: dict[str, Any], problem: str) -> None:
    with pytest.raises(ValueError, match=re.escape(problem)):
        Ranges(**fields)
    with pytest.raises(ValueError, match=re.escape(problem)):
        msgspec.structs.replace(Ranges(), **fields)


class Inner(Config, frozen=True, kw_only=True):
    gain: Ratio = 0.5


class Settings(Config, frozen=True, kw_only=True):
    low: Positive = 1.0
    high: Positive = 2.0
    inner: Inner = Inner()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.low > self.high:
            raise ValueError(f"low, high: expected low <= high, got {self.low}, {self.high}")


@pytest.mark.parametrize(
    ("override", "problem"),
    [
        ("low=0", "configuration of x.low: expected `float` > 0.0, got 0"),
        ("low=inf", "configuration of x.low: expected a finite number > 0, got inf"),
        ("inner.gain=2", "configuration of x.inner.gain: expected `float` <= 1.0, got 2"),
        ("low=3", "configuration of x: low, high: expected low <= high, got 3.0, 2.0"),
    ],
)
def test_a_bad_setting_names_path_range_and_value(override: str, problem: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(problem)):
        load(Settings, "x", None, [override], {})
