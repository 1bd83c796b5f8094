"""The base of all messages, and the types of fields that messages share.

Ranges, shapes and forms are declared once, as annotations, and checked by `Record`. A `float` is
finite unless it is annotated INFINITE.
"""

import re
from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np
import numpy.typing as npt
from msgspec import Meta

from people4d.validation import FINITE_ARRAY, INFINITE, Magnitude, Rule, Shape, check, require

# A leading dot or dash would turn a name into "..", a hidden file or a flag.
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}")
NAME_FORM = "1 to 64 characters from A-Z a-z 0-9 _ . -, the first neither . nor -"
MAX_TRACE = 64
MAX_SIDE = 16384  # [px]
MAX_PIXELS = 4096 * 4096  # maximum size of an image [px], a bound on allocated memory
# Larger values are faults of their sender; their squares and sums would overflow downstream.
MAX_STAMP_NS = 2**62  # [ns] the year 2116; sums and differences of two stamps fit 64 bits
MAX_M = 1e7  # maximum coordinate [m] and velocity [m/s]; UTM coordinates stay below
MAX_COVARIANCE = 1e14  # [m^2] square of MAX_M
MAX_CAMERAS = 64  # maximum number of cameras of one robot, a bound against invented names
MAX_PX = 1e6  # [px] maximum coordinate of a position, inside or outside an image
# Maximum sequence number: exact in every language, sums of gaps fit 64 bits
MAX_SEQUENCE = 2**53 - 1

Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]
PositiveOrInfinite = Annotated[float, Meta(gt=0), INFINITE]
Ratio = Annotated[float, Meta(ge=0, le=1)]
Probability = Ratio
Correlation = Annotated[float, Meta(ge=-1, le=1)]
Count = Annotated[int, Meta(ge=0)]
Index = Count
PositiveInt = Annotated[int, Meta(ge=1)]
ImageSide = Annotated[int, Meta(ge=1, le=MAX_SIDE)]  # [px]

NAME_RULE = Rule(NAME_FORM, lambda name: bool(NAME.fullmatch(name)))
Name = Annotated[str, NAME_RULE]
NameOrEmpty = Annotated[
    str, Rule(f"{NAME_FORM}, or nothing", lambda name: not name or bool(NAME.fullmatch(name)))
]
# Texts are printable: no control character or line break reaches a terminal.
Text = Annotated[str, Rule("printable text", str.isprintable)]

U8 = npt.NDArray[np.uint8]
U16 = npt.NDArray[np.uint16]
F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

Metres = Annotated[float, Meta(ge=-MAX_M, le=MAX_M)]
Radians = Annotated[float, Meta(ge=-100, le=100)]
Vector2 = Annotated[F64, Shape(2), Magnitude(MAX_M)]
Vector3 = Annotated[F64, Shape(3), Magnitude(MAX_M)]
Matrix3 = Annotated[F64, Shape(3, 3), Magnitude(MAX_COVARIANCE)]
Matrix4 = Annotated[F64, Shape(4, 4), Magnitude(MAX_M)]
Matrix6 = Annotated[F64, Shape(6, 6), Magnitude(MAX_COVARIANCE)]
Box = Annotated[F32, Shape(4), Magnitude(MAX_PX)]
Keypoints = Annotated[F32, Shape(17, 3), Magnitude(MAX_PX)]
RgbImage = Annotated[
    U8,
    Shape("H", "W", 3),
    Rule("at least one pixel", lambda image: image.size > 0, lambda _: "none"),
]


# Printable text of spans, which msgspec checks while decoding.
PlainText = Annotated[str, Meta(max_length=256, pattern=r"^[^\x00-\x1f\x7f-\x9f\u2028\u2029]*$")]


class Span(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One stage of processing of a message, on the clock of its process's host."""

    stage: PlainText  # "<service>.<stage>", for example "detector.inference"
    process: PlainText  # instance that did the work, "<instance>@<host>"
    start_ns: int  # [ns] wall clock (Unix epoch) when the stage began
    end_ns: int  # [ns] wall clock (Unix epoch) when the stage ended


class Record(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of messages and their parts: every field is checked against its annotation."""

    def __post_init__(self) -> None:
        """Check the fields.

        Raises:
            ValueError: A value is out of range, not finite, or of another shape or form.
        """
        check(self)


class Message(Record, frozen=True, kw_only=True):
    """Base of every message: acquisition time, sequence number and trace of stages."""

    VERSION: ClassVar[int] = 1

    # [ns] acquisition time of the data (Unix epoch, or the recording's own clock)
    stamp_ns: Annotated[int, Meta(ge=-MAX_STAMP_NS, le=MAX_STAMP_NS)]
    # counts up by one per frame of a camera, else per message of its publisher
    sequence: Annotated[int, Meta(ge=0, le=MAX_SEQUENCE)]
    # stages of processing so far, oldest first
    trace: Annotated[tuple[Span, ...], Meta(max_length=MAX_TRACE)] = ()


def check_name(field: str, value: str) -> None:
    """Check that a name can be one chunk of a key expression.

    Raises:
        ValueError: It is not of NAME_FORM.
    """
    require(field, value, NAME_RULE)


def check_size(width: int, height: int) -> None:
    """Check the number of pixels of an image.

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

    Raises:
        ValueError: The number of axes or one of the lengths differs.
    """
    require(field, array, Shape(*shape).rule())


def check_finite(field: str, array: npt.NDArray[Any] | None) -> None:
    """Check that no element of an array is NaN or infinite.

    Raises:
        ValueError: An element is NaN or infinite.
    """
    require(field, array, FINITE_ARRAY)
