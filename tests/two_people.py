"""Truth of the simulated room with two people, each array read once."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt


@cache
def truth_of(shared: Path, name: str) -> npt.NDArray[Any]:
    """Return an array of `gt.npz`, see lab/truth/files.py; a row is a frame."""
    with np.load(shared / "data" / "lab" / "two" / "gt.npz") as file:
        return np.asarray(file[name])
