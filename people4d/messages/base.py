"""What every message has, and the checks that messages share."""

import re
from typing import Any, ClassVar

import msgspec
import numpy as np
import numpy.typing as npt

# A dot or dash at the start would make "..", a hidden file or a flag of a name.
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}")

U8 = npt.NDArray[np.uint8]
U16 = npt.NDArray[np.uint16]
F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

MAX_TRACE = 64
MAX_SIDE = 16384  # [px]
MAX_PIXELS = 4096 * 4096  # more is no RGB-D camera; it bounds what is allocated for a picture
MAX_SEQUENCE = 2**53 - 1  # exact in every language; sums of gaps stay below 64 bits


class Span(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One stage that a message passed, on the clock of the host named by its process."""

    stage: str  # "<service>.<stage>", for example "detector.inference"
    process: str  # instance that did the work, "<instance>@<host>"
    start_ns: int  # [ns] wall clock (Unix epoch) when the stage began
    end_ns: int  # [ns] wall clock (Unix epoch) when the stage ended


class Message(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of every message: when it was seen, its number, and the way it came."""

    VERSION: ClassVar[int] = 1

    stamp_ns: int  # [ns] acquisition time of the data (Unix epoch, or the recording's own clock)
    sequence: int  # counts up by one per frame of a camera, else per message of its publisher
    trace: tuple[Span, ...] = ()  # stages passed so far, oldest first

    def __post_init__(self) -> None:
        """Check the header.

        Raises:
            ValueError: A number is out of range or the trace is too long.
        """
        if not 0 <= self.sequence <= MAX_SEQUENCE:
            raise ValueError(f"sequence: expected 0 to {MAX_SEQUENCE}, got {self.sequence}")
        if not -(2**63) <= self.stamp_ns < 2**63:
            raise ValueError(f"stamp_ns: expected a signed 64-bit number, got {self.stamp_ns}")
        if len(self.trace) > MAX_TRACE:
            raise ValueError(f"trace: expected at most {MAX_TRACE} stages, got {len(self.trace)}")


def check_name(field: str, value: str) -> None:
    """Check that a name can be one chunk of a key expression.

    Args:
        field: Name of the field, for the error.
        value: The name.

    Raises:
        ValueError: The name is empty, too long, begins with . or -, or has other characters than
            A-Z a-z 0-9 _ . -
    """
    if not NAME.fullmatch(value):
        raise ValueError(
            f"{field}: expected 1 to 64 of A-Z a-z 0-9 _ . -, not . or - first, got {value!r:.80}"
        )


def check_text(field: str, *values: str) -> None:
    """Check that texts for people hold nothing that a terminal takes for a command.

    Args:
        field: Name of the field, for the error.
        values: The texts.

    Raises:
        ValueError: One has a character that cannot be printed, a line break among them.
    """
    for value in values:
        if not value.isprintable():
            raise ValueError(f"{field}: expected printable text, got {value!r:.80}")


def check_size(width: int, height: int) -> None:
    """Check that a picture can be of these many pixels.

    Raises:
        ValueError: A side is less than 1 or too long, or there are too many pixels.
    """
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
        raise ValueError(f"width, height: expected 1 to {MAX_SIDE}, got {width}, {height}")
    if width * height > MAX_PIXELS:
        raise ValueError(
            f"width, height: expected {MAX_PIXELS} pixels at most, got {width * height}"
        )


def check_shape(field: str, array: npt.NDArray[Any] | None, shape: tuple[int | None, ...]) -> None:
    """Check the shape of an array; None stands for any length.

    Args:
        field: Name of the field, for the error.
        array: The array; None passes.
        shape: Expected lengths, None for any.

    Raises:
        ValueError: The number of axes or one of the lengths differs.
    """
    if array is None:
        return
    same_axes = array.ndim == len(shape)
    if not same_axes or any(
        want not in (None, got) for want, got in zip(shape, array.shape, strict=True)
    ):
        expected = "x".join("any" if n is None else str(n) for n in shape)
        got = "x".join(map(str, array.shape)) or "a scalar"
        raise ValueError(f"{field}: expected shape {expected}, got {got}")


def check_finite(field: str, *values: npt.NDArray[Any] | float | None) -> None:
    """Check that no value is NaN or infinite.

    Args:
        field: Name of the field, for the error.
        values: Numbers or arrays; None passes.

    Raises:
        ValueError: A value is NaN or infinite.
    """
    for value in values:
        if value is not None and not np.all(np.isfinite(value)):
            raise ValueError(f"{field}: expected finite numbers, got NaN or infinity")
