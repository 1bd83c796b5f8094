"""Messages of people4d in Foxglove's schemas, which its app opens without a plug-in."""

import math
from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from foxglove import Schema
from foxglove import messages as fox

from common.geometry.transform_buffer import transform_from_odometry
from common.io.images import decode_png16, encode_jpeg
from common.runtime.latency import end_to_end, merge_stages, segments
from deploy.viewers.foxglove_people import (
    annotations,
    people_update,
    predictions_update,
    skeletons_update,
)
from deploy.viewers.foxglove_primitives import pose_parts, stamp
from deploy.viewers.scene import PeopleScene
from people4d.errors import DecodeError
from people4d.messages import (
    F64,
    CameraInfo,
    CompressedRgbdFrame,
    Health,
    Message,
    MovingTransform,
    Odometry,
    Predictions,
    RgbdFrame,
    Skeletons,
    StaticTransform,
    Tracks,
)

REPEAT_NS = 10**9  # period of calibrations and static transforms, for late clients [ns]
JPEG_QUALITY = 80
DISTORTION = {"none": "plumb_bob"}

STRING = {"type": "string"}
NUMBERS = {"type": "object", "additionalProperties": {"type": "number"}}
JSON_SCHEMAS: dict[str, dict[str, Any]] = {  # JSON schemas by topic
    "/latency": {
        "type": "object",
        "title": "people4d.Latency",
        "properties": {"end_to_end_ms": {"type": "number"}, "stages_ms": NUMBERS},
    },
    "/health": {
        "type": "object",
        "title": "people4d.Health",
        "properties": {
            **dict.fromkeys(("instance", "host", "state", "reason"), STRING),
            **dict.fromkeys(("gauges", "counters"), NUMBERS),
        },
    },
}


class FoxgloveMessage(Protocol):
    """Message of one of Foxglove's schemas."""

    @classmethod
    def get_schema(cls) -> Schema:
        """Return the schema."""

    def encode(self) -> bytes:
        """Return the message in protobuf."""


Content = FoxgloveMessage | dict[str, Any]  # a dict follows JSON_SCHEMAS
Item = tuple[str, Content]  # topic and content


class FoxgloveConverter:
    """Converts messages to topics and contents of Foxglove.

    Args:
        images: Include colour and depth.
    """

    def __init__(self, images: bool) -> None:
        self._images = images
        self._scene = PeopleScene()
        self._static: dict[str, StaticTransform] = {}
        self._repeated_ns: int | None = None
        self.bad_images = 0  # number of frames that could not be decoded

    def convert(self, message: Message, log_time_ns: int) -> Iterator[Item]:
        """Yield the topics and contents of a message received at `log_time_ns`."""
        people = self._scene.add_message(message)
        if isinstance(message, CameraInfo | StaticTransform):
            if isinstance(message, StaticTransform):
                self._static[message.child] = message
            self._repeated_ns = None
        last_ns = self._repeated_ns
        if last_ns is None or not 0 <= log_time_ns - last_ns < REPEAT_NS:
            self._repeated_ns = log_time_ns
            yield from self._latched(log_time_ns)
        if isinstance(message, RgbdFrame | CompressedRgbdFrame):
            yield from self._frame(message)
        elif isinstance(message, MovingTransform):
            edge = message.parent, message.child, message.matrix
            yield "/tf", _transforms(message.stamp_ns, edge)
        elif isinstance(message, Odometry):
            edge = message.frame_id, message.child_frame_id, transform_from_odometry(message)
            yield "/tf", _transforms(message.stamp_ns, edge)
        elif isinstance(message, Predictions):
            yield "/predictions", predictions_update(message)
        elif isinstance(message, Skeletons):
            yield "/skeletons", skeletons_update(self._scene.skeletons(message))
        elif isinstance(message, Health):
            yield "/health", _health(message)
        if people:
            yield "/people", people_update(people)
            yield f"/{people.tracks.camera}/annotations", annotations(people)
            if people.skeletons:
                yield "/skeletons", skeletons_update(people.skeletons)
            if people.tracks.trace:
                yield "/latency", _latency(people.tracks)

    def _latched(self, log_time_ns: int) -> Iterator[Item]:
        for info in self._scene.infos.values():
            yield f"/{info.camera}/calibration", _calibration(info, log_time_ns)
        if self._static:
            static = ((t.parent, t.child, t.matrix) for t in self._static.values())
            yield "/tf_static", _transforms(log_time_ns, *static)

    def _frame(self, frame: RgbdFrame | CompressedRgbdFrame) -> Iterator[Item]:
        if not self._images:
            return
        info = self._scene.infos.get(frame.camera)
        header: dict[str, Any] = {
            "timestamp": stamp(frame.stamp_ns),
            "frame_id": info.frame_id if info else f"{frame.camera}_optical_frame",
        }
        if isinstance(frame, RgbdFrame):
            jpeg, depth_mm = encode_jpeg(frame.rgb, JPEG_QUALITY), frame.depth_mm
        else:
            try:
                jpeg, depth_mm = frame.rgb_jpeg, decode_png16(frame.depth_png)
            except DecodeError:
                self.bad_images += 1
                return
        yield (f"/{frame.camera}/image", fox.CompressedImage(**header, data=jpeg, format="jpeg"))
        height, width = depth_mm.shape
        yield (
            f"/{frame.camera}/depth",
            fox.RawImage(
                **header,
                width=width,
                height=height,
                encoding="16UC1",
                step=2 * width,
                data=np.ascontiguousarray(depth_mm, "<u2").tobytes(),
            ),
        )


def _calibration(info: CameraInfo, log_time_ns: int) -> fox.CameraCalibration:
    return fox.CameraCalibration(
        timestamp=stamp(log_time_ns),
        frame_id=info.frame_id,
        width=info.width,
        height=info.height,
        distortion_model=DISTORTION.get(info.distortion_model, info.distortion_model),
        D=list(info.distortion) or [0.0] * 5,
        K=[info.fx, 0, info.cx, 0, info.fy, info.cy, 0, 0, 1],
        R=[1, 0, 0, 0, 1, 0, 0, 0, 1],
        P=[info.fx, 0, info.cx, 0, 0, info.fy, info.cy, 0, 0, 0, 1, 0],
    )


def _transforms(stamp_ns: int, *edges: tuple[str, str, F64]) -> fox.FrameTransforms:
    transforms = []
    for parent, child, matrix in edges:
        translation, rotation = pose_parts(matrix)
        transforms.append(
            fox.FrameTransform(
                timestamp=stamp(stamp_ns),
                parent_frame_id=parent,
                child_frame_id=child,
                translation=translation,
                rotation=rotation,
            )
        )
    return fox.FrameTransforms(transforms=transforms)


def _latency(tracks: Tracks) -> dict[str, Any]:
    total = end_to_end(tracks.trace)
    stages = {part.name: part.ms for part in merge_stages(segments(tracks.trace))}
    return {"end_to_end_ms": total.ms if total else None, "stages_ms": stages}


def _health(message: Health) -> dict[str, Any]:
    finite = {n: v for n, v in message.gauges.items() if math.isfinite(v)}
    return {
        "instance": message.instance,
        "host": message.host,
        "state": message.state,
        "reason": message.reason,
        "gauges": finite,
        "counters": dict(message.counters),
    }
