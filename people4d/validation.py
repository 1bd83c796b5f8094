"""Checks of records, derived from the annotations of their fields.

msgspec enforces `Meta` when it decodes; a record that is made in code is checked here, where arrays
and finite numbers are checked, too.
"""

import math
import re
import types
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Annotated, Any, NamedTuple, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np

FEW = 16  # maximum size of an array whose length is faster from numbers
INFINITE = object()  # annotation of a float that may be infinite, but not NaN

Passes = Callable[[Any], bool]

SIGNS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}


def describe(value: Any) -> str:
    """Describe a wrong or untrusted value in few words; nested values by their type only."""
    return f"{value!r:.80}" if isinstance(value, str | int | float) else type(value).__name__


class Rule(NamedTuple):
    """A condition on the value of a field.

    Args:
        expected: The values that pass, for the error.
        passes: Returns True for values that pass.
        describe: Writes a value that does not pass.
    """

    expected: str
    passes: Passes
    describe: Callable[[Any], str] = describe

    def error(self, field: str, value: Any) -> ValueError:
        """Return the error of a field with a value that does not pass."""
        return ValueError(f"{field}: expected {self.expected}, got {self.describe(value)}")


class Shape:
    """Annotation of an array: lengths of its axes, a letter for any length: Shape("N", 3)."""

    def __init__(self, *lengths: int | str | None) -> None:
        self.lengths = lengths
        self._fixed = [(i, length) for i, length in enumerate(lengths) if isinstance(length, int)]
        self._is_fixed = len(self._fixed) == len(lengths)

    def __str__(self) -> str:
        return "x".join(map(str, self.lengths))

    def rule(self) -> Rule:
        """Return the condition on an array."""
        return Rule(f"shape {self}", self._passes, _shape_text)

    def _passes(self, array: Any) -> bool:
        shape: tuple[int, ...] = array.shape
        if self._is_fixed:
            return shape == self.lengths
        return len(shape) == len(self.lengths) and all(shape[i] == n for i, n in self._fixed)


class Magnitude:
    """Annotation of an array of floats: the largest absolute value of its elements."""

    def __init__(self, maximum: float) -> None:
        self.maximum = maximum
        self._safe = 0.99 * maximum

    def __str__(self) -> str:
        return f"+-{self.maximum:g}"

    def rule(self) -> Rule:
        """Return the condition on an array; NaN and infinity fail it."""
        return Rule(
            f"finite numbers of -{self.maximum:g} to {self.maximum:g}", self._passes, _worst
        )

    def _passes(self, array: Any) -> bool:
        # The length takes a seventh of the time and decides nearly always. NaN compares as false;
        # squares of integers would wrap around.
        if array.size <= FEW:
            if math.hypot(*array.flat) < self._safe:
                return True
        elif array.dtype.kind == "f" and np.vdot(array, array) < self._safe**2:
            return True
        return not array.size or bool(np.abs(array).max() <= self.maximum)


def _worst(array: Any) -> str:
    return "NaN or infinity" if not _all_finite(array) else f"{np.abs(array).max():g}"


def _shape_text(array: Any) -> str:
    return "x".join(map(str, array.shape)) or "a scalar"


def _all_finite(array: Any) -> bool:
    # Twice as fast as np.isfinite(array).all() for a few numbers.
    return bool(np.count_nonzero(np.isfinite(array)) == array.size)


FINITE_ARRAY = Rule("finite numbers", _all_finite, lambda _: "NaN or infinity")


def check(record: msgspec.Struct) -> None:
    """Check every field of a record against its annotation; None passes.

    Raises:
        ValueError: A number is out of range, NaN or infinite, an array has another shape, or a text
            is not of the annotated form.
    """
    for name, passes, rule in field_rules(type(record)):
        value = getattr(record, name)
        if value is not None and not passes(value):
            raise rule.error(name, value)


def require(field: str, value: Any, rule: Rule) -> None:
    """Check one value; None passes.

    Raises:
        ValueError: The rule is broken.
    """
    if value is not None and not rule.passes(value):
        raise rule.error(field, value)


@cache
def field_rules(record: type[msgspec.Struct]) -> tuple[tuple[str, Passes, Rule], ...]:
    """Return the name, the condition and the rule for each rule of a record type's fields."""
    hints = get_type_hints(record, include_extras=True)
    return tuple(
        (name, rule.passes, rule)
        for name in record.__struct_fields__
        for rule in _rules(hints[name])
    )


def explain(error: Exception, values: Any, root: str) -> str:
    """Return an error of msgspec as text with the path of the field and its value.

    Args:
        error: Error raised by msgspec.convert.
        values: Converted values.
        root: First part of the path.
    """
    problem, _, path = str(error).partition(" - at `$")
    path = path.rstrip("`")
    if re.match(r"(\w+): (?=expected)", problem):  # raised by a record's own check
        return f"{root}{path}.{problem}"
    problem = problem[:1].lower() + problem[1:]
    if problem.startswith("expected") and ", got" not in problem:
        problem += _got(values, path)
    return f"{root}{path}: {problem}"


def _got(values: Any, path: str) -> str:
    for name, index in re.findall(r"\.([^.\[\]]+)|\[(\d+)\]", path):
        try:
            values = values[name or int(index)]
        except (LookupError, TypeError):
            return ""
    return f", got {describe(values)}"


def _rules(hint: Any) -> Iterator[Rule]:
    """Yield the rules of an annotation, then the rules of its elements."""
    union = get_origin(hint) in (Union, types.UnionType)
    members = [kind for kind in get_args(hint) if kind is not type(None)] if union else [hint]
    if len(members) != 1:
        return
    annotated = get_origin(members[0]) is Annotated
    kind, *extras = get_args(members[0]) if annotated else members
    for extra in extras:
        if isinstance(extra, Shape | Magnitude | Rule):
            yield extra if isinstance(extra, Rule) else extra.rule()
    bounds = [extra for extra in extras if isinstance(extra, msgspec.Meta)]
    if kind is float or (kind is int and bounds):
        yield _number_rule(bounds, finite=kind is float and INFINITE not in extras)
        return
    for bound in bounds:
        yield from _length_rules(bound)
    if not any(isinstance(extra, Magnitude) for extra in extras):
        yield from _element_rules(kind)


def _number_rule(bounds: Sequence[msgspec.Meta], finite: bool) -> Rule:
    """Return the rule of a number, which NaN always fails."""
    expected, passes = range_text(bounds), _range_check(_limits(bounds), finite)
    if finite and " to " not in expected:
        expected = f"a finite number {expected}".strip()
    return Rule(expected or "a number", passes)


def _range_check(limits: Mapping[str, float], finite: bool) -> Callable[[float], bool]:
    # Short forms, since decoding runs them for every number.
    if finite and not limits:
        return math.isfinite
    low = max(limits.get("ge", -math.inf), limits.get("gt", -math.inf))
    high = min(limits.get("le", math.inf), limits.get("lt", math.inf))
    excluded = [limits[sign] for sign in ("gt", "lt") if sign in limits]
    if not excluded and (not finite or -math.inf < low <= high < math.inf):
        return lambda x: low <= x <= high
    if not finite:
        return lambda x: low <= x <= high and x not in excluded
    return lambda x: math.isfinite(x) and low <= x <= high and x not in excluded


def range_text(bounds: Sequence[msgspec.Meta]) -> str:
    """Return limits of a number as text: "0 to 1" or "> 0"."""
    limits = _limits(bounds)
    if limits.keys() == {"ge", "le"}:
        return f"{limits['ge']} to {limits['le']}"
    return " and ".join(f"{SIGNS[sign]} {limit}" for sign, limit in limits.items())


def _limits(bounds: Sequence[msgspec.Meta]) -> dict[str, float]:
    found = {sign: getattr(bound, sign) for bound in bounds for sign in SIGNS}
    return {sign: limit for sign, limit in found.items() if limit is not None}


def _length_rules(bound: msgspec.Meta) -> Iterator[Rule]:
    low, high = bound.min_length or 0, bound.max_length
    if low:
        yield Rule(f"at least {low} elements", lambda x: len(x) >= low, lambda x: str(len(x)))
    if high is not None:
        yield Rule(f"at most {high} elements", lambda x: len(x) <= high, lambda x: str(len(x)))


def _element_rules(kind: Any) -> Iterator[Rule]:
    """Yield the rules of the elements of an array, tuple or list, or of the values of a dict."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is np.ndarray:
        if np.issubdtype(get_args(arguments[1])[0], np.floating):
            yield FINITE_ARRAY
    elif origin is dict:
        yield from (_each(rule, dict.keys) for rule in _rules(arguments[0]))
        yield from (_each(rule, dict.values) for rule in _rules(arguments[1]))
    elif origin in (tuple, list) and len(elements := set(arguments) - {Ellipsis}) == 1:
        yield from (_each(rule, iter) for rule in _rules(elements.pop()))


def _each(rule: Rule, elements: Callable[[Any], Iterable[Any]]) -> Rule:
    def failing(values: Any) -> Iterator[Any]:
        return (value for value in elements(values) if not (value is None or rule.passes(value)))

    return Rule(
        f"elements {rule.expected}" if rule.expected[0] in "<>" else rule.expected,
        lambda values: not any(True for _ in failing(values)),
        lambda values: rule.describe(next(failing(values))),
    )
