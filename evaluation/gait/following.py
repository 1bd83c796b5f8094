"""Follows people through a recording, without any other process."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import msgspec
import numpy as np

from common.runtime.node import Node
from evaluation.methods import Method
from evaluation.pipeline import pipeline, play
from people4d.errors import SourceError
from people4d.messages import (
    CameraInfo,
    Detections,
    Message,
    MovingTransform,
    Odometry,
    RgbdFrame,
    StaticTransform,
)
from services.camera.config import CameraConfig
from services.gait.build import build
from services.gait.cascade import Seen
from services.gait.config import GaitConfig
from services.gait.people import COUNTERS, Found, People, Scene
from services.gait.places import Places

Box = tuple[float, float, float, float]  # [px] left, top, right, bottom
Watch = Callable[[CameraInfo, Scene, Sequence[Found]], None]
FOR_EVER_S = 1e9
FRAME_ID = "map"


@dataclass(frozen=True)
class LaunchRequest:
    """What is followed in what.

    Args:
        source: Recording, bag, folder or lab:SCENARIO.
        method: How people are found and tracked; of `box` only how the recording is played.
        gait: How their points are followed.
        box: Of one person in the first frame, whom colours alone follow from there; None: everybody
            is found and tracked.
    """

    source: str
    method: Method
    gait: GaitConfig
    box: Box | None


def follow(request: LaunchRequest, watch: Watch) -> Iterator[int]:
    """Follow people; yield the stamp of each frame that was done.

    Args:
        request: What is followed.
        watch: Told of every frame in which people could be looked for.

    Raises:
        SourceError: The source cannot be played, or nothing is in the box.
        ModelError: A model is absent.
    """
    camera = msgspec.structs.replace(
        request.method.camera,
        source=request.source,
        playback="lockstep",
        answer="detections",
        window=1,
        start_delay_s=0.0,
        loop=False,
    )
    return (
        _follow_all(camera, request, watch)
        if request.box is None
        else _follow_box(camera, request, watch)
    )


def _follow_all(camera: CameraConfig, request: LaunchRequest, watch: Watch) -> Iterator[int]:
    method = request.method
    # What has not come when the next frame is asked for never comes.
    tracker = msgspec.structs.replace(method.tracker, embedding_wait_s=0.0, reorder_wait_s=0.0)
    nodes = [*pipeline(method.detector, method.reid, tracker), build(request.gait, watch)]
    for step in play(camera, nodes):
        yield from (m.stamp_ns for m in step.messages if isinstance(m, RgbdFrame))


def _follow_box(camera: CameraConfig, request: LaunchRequest, watch: Watch) -> Iterator[int]:
    places, counters = Places(request.gait.base), Counter(dict.fromkeys(COUNTERS, 0))
    seen = Seen(id=1, box_xyxy_px=np.array(request.box, np.float64))
    people: People | None = None
    info: CameraInfo | None = None
    config = by_colour(request.gait)
    for step in play(camera, [_Answer()]):
        for message in step.messages:
            if isinstance(message, StaticTransform | MovingTransform | Odometry):
                places.add(message)
            elif isinstance(message, CameraInfo):
                info, people = message, People(config, message, counters)
            elif isinstance(message, RgbdFrame) and info and people:
                pose = places.find(FRAME_ID, info.frame_id, message.stamp_ns)
                if pose is None:
                    continue
                scene = Scene(message.stamp_ns, message.rgb, message.depth_mm, (seen,), pose)
                found = people.update(scene)
                _check(found, seen)
                watch(info, scene, found or ())
                seen = Seen(id=1)
                yield message.stamp_ns


def by_colour(config: GaitConfig) -> GaitConfig:
    """Return the configuration with which colours follow a box for ever, as in the paper."""
    cascade = msgspec.structs.replace(
        config.cascade, carry_s=FOR_EVER_S, forget_s=FOR_EVER_S, colour_distance_max=1.0
    )
    return msgspec.structs.replace(config, cascade=cascade)


def _check(found: Sequence[Found] | None, seen: Seen) -> None:
    """Check that the person of the first frame can be followed.

    Raises:
        SourceError: They cannot.
    """
    if found is None:
        raise SourceError("frames are of another size than calibrated")
    known = found and any(point.state != "lost" for point in found[0].person.points)
    if seen.box_xyxy_px is not None and not known:
        raise SourceError(
            "nobody is in that box of the first frame",
            "Write it as left,top,right,bottom in pixels, or leave it out: --person auto.",
        )


class _Answer(Node):
    """Tells that each frame was taken, so that the next one comes."""

    inputs: ClassVar[tuple[type[Message], ...]] = (RgbdFrame,)

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        if not isinstance(message, RgbdFrame):
            return ()
        height, width = message.rgb.shape[:2]
        nobody = Detections(
            stamp_ns=message.stamp_ns,
            sequence=message.sequence,
            camera=message.camera,
            frame_id=message.camera,
            model="none",
            width=width,
            height=height,
        )
        return [nobody]
