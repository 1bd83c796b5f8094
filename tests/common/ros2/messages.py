"""Messages of ROS 2 with a value in every field, and their fields as plain objects."""

import random
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype

from common.ros2.types import Fields, typestore


def filled(kind: str, seed: int = 0) -> Fields:
    """Return fields of a message, all with values."""
    return _message(kind, random.Random(f"{kind} {seed}"))


def plain(value: Any) -> Any:
    """Return a message, or a part of one, as dictionaries, lists, numbers and texts."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list):
        return [plain(item) for item in value]
    if isinstance(value, int | float | str | bool):
        return value
    names = [name for name, _ in typestore().fielddefs[value.__msgtype__][1]]
    return {name: plain(getattr(value, name)) for name in names}


def _message(kind: str, numbers: random.Random) -> Fields:
    fields = typestore().fielddefs[kind][1]
    return {name: _value(node, detail, numbers) for name, (node, detail) in fields}


def _value(node: Nodetype, detail: Any, numbers: random.Random) -> Any:
    if node is Nodetype.NAME:
        return _message(str(detail), numbers)
    if node is not Nodetype.BASE:
        (inner, inner_detail), size = detail
        count = size if node is Nodetype.ARRAY else numbers.randint(1, 4)
        return [_value(inner, inner_detail, numbers) for _ in range(count)]
    kind = detail[0]
    if kind == "string":
        return "".join(numbers.choices("abc /_é→", k=numbers.randint(1, 9)))
    if kind == "bool":
        return numbers.random() < 0.5
    if kind.startswith("float"):
        number = numbers.uniform(-1e3, 1e3)
        return float(np.float32(number)) if kind == "float32" else number
    if kind == "byte":  # rosbags reads it as signed, the IDL of ROS as unsigned
        return numbers.randint(0, 127)
    limits = np.iinfo(np.uint8 if kind == "char" else kind)
    return numbers.randint(int(limits.min), int(limits.max))
