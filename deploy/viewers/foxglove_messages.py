"""Our messages as messages of Foxglove's schemas, which its app opens without a plug-in."""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from foxglove import messages as fox

from common.geometry.transform_buffer import transform_from_odometry
from common.io.images import decode_png16
from common.runtime.latency import end_to_end, merge_stages, segments
from deploy.viewers.colour_images import ColourEncoder
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

REPEAT_NS = 10**9  # after which calibration and fixed transforms come again, for late clients
DISTORTION = {"none": "plumb_bob"}

LATENCY_SCHEMA = {
    "type": "object",
    "title": "people4d.Latency",
    "properties": {
        "end_to_end_ms": {"type": "number"},
        "stages_ms": {"type": "object", "additionalProperties": {"type": "number"}},
    },
}
HEALTH_SCHEMA = {
    "type": "object",
    "title": "people4d.Health",
    "properties": {
        "instance": {"type": "string"},
        "host": {"type": "string"},
        "state": {"type": "string"},
        "reason": {"type": "string"},
        "gauges": {"type": "object", "additionalProperties": {"type": "number"}},
        "counters": {"type": "object", "additionalProperties": {"type": "number"}},
    },
}


@dataclass(frozen=True, slots=True)
class FoxgloveItem:
    """An encoded message of one of Foxglove's schemas, or of a JSON schema."""

    topic: str
    encoding: str  # of the message: "protobuf" or "json"
    schema_name: str  # for example "foxglove.SceneUpdate"
    schema_encoding: str  # "protobuf" or "jsonschema"
    schema: bytes
    data: bytes


class FoxgloveConverter:
    """Converts messages as they come.

    Args:
        images: Encodes colour; None leaves colour and depth out.
    """

    def __init__(self, images: ColourEncoder | None) -> None:
        self._images = images
        self._scene = PeopleScene()
        self._static: dict[str, StaticTransform] = {}
        self._repeated_ns: int | None = None
        self.bad_images = 0  # frames left out since they could not be decoded

    def convert(self, message: Message, log_time_ns: int) -> Iterator[FoxgloveItem]:
        """Yield what a message becomes; `log_time_ns` is when it was received."""
        people = self._scene.add(message)
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
            yield _item(
                "/tf",
                _transforms(message.stamp_ns, (message.parent, message.child, message.matrix)),
            )
        elif isinstance(message, Odometry):
            frames = message.frame_id, message.child_frame_id, transform_from_odometry(message)
            yield _item("/tf", _transforms(message.stamp_ns, frames))
        elif isinstance(message, Predictions):
            yield _item("/predictions", predictions_update(message))
        elif isinstance(message, Skeletons):
            yield _item("/skeletons", skeletons_update(self._scene.skeletons(message)))
        elif isinstance(message, Health):
            yield _json("/health", HEALTH_SCHEMA, _health(message))
        if people:
            yield _item("/people", people_update(people))
            yield _item(f"/{people.tracks.camera}/annotations", annotations(people))
            if people.skeletons:
                yield _item("/skeletons", skeletons_update(people.skeletons))
            if people.tracks.trace:
                yield _json("/latency", LATENCY_SCHEMA, _latency(people.tracks))

    def _latched(self, log_time_ns: int) -> Iterator[FoxgloveItem]:
        for info in self._scene.infos.values():
            yield _item(f"/{info.camera}/calibration", _calibration(info, log_time_ns))
        if self._static:
            static = ((t.parent, t.child, t.matrix) for t in self._static.values())
            yield _item("/tf_static", _transforms(log_time_ns, *static))

    def _frame(self, frame: RgbdFrame | CompressedRgbdFrame) -> Iterator[FoxgloveItem]:
        if self._images is None:
            return
        info = self._scene.infos.get(frame.camera)
        header: dict[str, Any] = {
            "timestamp": stamp(frame.stamp_ns),
            "frame_id": info.frame_id if info else f"{frame.camera}_optical_frame",
        }
        try:
            colour = self._images.encode(frame)
            depth_mm = (
                frame.depth_mm if isinstance(frame, RgbdFrame) else decode_png16(frame.depth_png)
            )
        except DecodeError:
            self.bad_images += 1
            return
        kind = fox.CompressedVideo if self._images.format == "h264" else fox.CompressedImage
        yield _item(
            f"/{frame.camera}/image", kind(**header, data=colour, format=self._images.format)
        )
        height, width = depth_mm.shape
        yield _item(
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


def _item(topic: str, message: Any) -> FoxgloveItem:
    schema = message.get_schema()
    return FoxgloveItem(
        topic, "protobuf", schema.name, schema.encoding, schema.data, message.encode()
    )


def _json(topic: str, schema: dict[str, Any], values: dict[str, Any]) -> FoxgloveItem:
    described = json.dumps(schema).encode()
    data = json.dumps(values, allow_nan=False).encode()
    return FoxgloveItem(topic, "json", schema["title"], "jsonschema", described, data)


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


def _transforms(stamp_ns: int, *frames: tuple[str, str, F64]) -> fox.FrameTransforms:
    transforms = []
    for parent, child, matrix in frames:
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
