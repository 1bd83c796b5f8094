"""Faults of a camera, as changes of its messages."""

from collections.abc import Callable

import numpy as np
from msgspec.structs import replace

from common.geometry.transforms import rotation_from_rpy
from people4d.messages import Detections, Embeddings, Message

# Function of a message and its true time; None: a lost message
Change = Callable[[int, Message], Message | None]


def covered(camera: str, from_ns: int) -> Change:
    """Return the change by a covered lens: frames without people."""

    def change(time_ns: int, message: Message) -> Message | None:
        if isinstance(message, Detections) and message.camera == camera and time_ns >= from_ns:
            return replace(message, detections=())
        return message

    return change


def knocked(camera: str, degrees: float, from_ns: int) -> Change:
    """Return the change by a rotation of a camera about the vertical at a time."""

    def change(time_ns: int, message: Message) -> Message | None:
        if not isinstance(message, Detections) or message.camera != camera or time_ns < from_ns:
            return message
        turn = rotation_from_rpy(0.0, np.radians(degrees), 0.0)
        people = tuple(
            d if d.position_m is None else replace(d, position_m=turn @ d.position_m)
            for d in message.detections
        )
        return replace(message, detections=people)

    return change


def late_clock(camera: str, seconds: float, ppm: float, start_ns: int) -> Change:
    """Return the change by a clock of one camera with an offset and a drift."""

    def change(time_ns: int, message: Message) -> Message | None:
        if not isinstance(message, Detections | Embeddings) or message.camera != camera:
            return message
        drift_ns = round((time_ns - start_ns) * ppm * 1e-6)
        return replace(message, stamp_ns=message.stamp_ns + round(seconds * 1e9) + drift_ns)

    return change


def dead(camera: str, from_ns: int) -> Change:
    """Return the change by a camera that stops sending at a time."""

    def change(time_ns: int, message: Message) -> Message | None:
        is_lost = getattr(message, "camera", "") == camera and time_ns >= from_ns
        return None if is_lost else message

    return change


def nothing(time_ns: int, message: Message) -> Message | None:  # noqa: ARG001
    """Return a message unchanged."""
    return message
