"""What fuzzing found, as small as it gets: each input once ended in what it must not."""

import sqlite3
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.codec import encode
from tests.camera.bags import Ros, frames
from tests.contract.examples import BY_NAME


@dataclass(frozen=True)
class Regression:
    """One finding.

    Args:
        name: Target, see `tests.fuzz.targets`.
        story: What happened.
        make: Makes the input; gets a folder.
    """

    name: str
    story: str
    make: Callable[[Path], bytes]


def _long_heading(_: Path) -> bytes:
    heading, long = np.array([0.6, 0.0, -0.8]), np.array([1e255, 0.0, -0.8])
    return encode(BY_NAME["Detections"]).replace(heading.tobytes(), long.tobytes())


def _changed(statement: str) -> Callable[[Path], bytes]:
    """Return what makes a bag and changes its database."""

    def make(folder: Path) -> bytes:
        path = Ros(2).write(folder / "bag", frames(Ros(2), 1)) / "bag.db3"
        with sqlite3.connect(path) as database:
            database.execute(statement)
        return path.read_bytes()

    return make


REGRESSIONS: Sequence[Regression] = (
    Regression(
        "message Detections",
        "a heading of length 1e255 overflowed with a warning instead of being refused",
        _long_heading,
    ),
    Regression(
        "ROS 2 bag (SQLite)",
        "a type stored as bytes instead of text raised TypeError",
        _changed("UPDATE topics SET type = x'00'"),
    ),
    Regression(
        "ROS 2 bag (SQLite)",
        "a time stored as text was taken for a stamp",
        _changed("UPDATE messages SET timestamp = 'soon'"),
    ),
)
