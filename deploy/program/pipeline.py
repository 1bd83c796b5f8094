"""The pipeline in memory."""

import json
from collections.abc import Mapping, Sequence
from fractions import Fraction
from types import TracebackType
from typing import Any, Self, TypeVar

import numpy.typing as npt

from common.calibration.transforms_file import MAP
from common.config import setting
from common.drawing.people import annotate
from common.transport.memory_bus import MemoryBus
from deploy.program.images import CameraImages
from evaluation.methods import read_method
from people4d.errors import ConfigError, People4dError, SourceError
from people4d.messages import U8, Detections, Message, MovingTransform, Odometry, RgbdFrame, Tracks
from people4d.messages.base import MAX_STAMP_NS
from people4d.validation import describe
from services.camera.calibration import Intrinsics
from services.camera.upright import turned_image, turned_info, turned_transforms, turns_of
from services.detector.build import build as build_detector
from services.reid.build import build as build_reid
from services.tracker.build import build as build_tracker

M = TypeVar("M", bound=Message)


class Pipeline:
    """Detector, re-identification and tracker joined in memory; results are deterministic.

    Frames are processed in the calling thread, oldest first; a context manager, or `close` at the
    end. ConfigError if the preset or a setting is unknown, or a value is out of range; ModelError
    if the file of a network is absent or altered.

    Args:
        preset: Method, as `people4d up --preset`; empty: the defaults.
        settings: Settings that override the preset: {"tracker.max_lost_s": 3.0}.
    """

    def __init__(self, preset: str = "", settings: Mapping[str, Any] | None = None) -> None:
        texts = [_setting(name, value) for name, value in (settings or {}).items()]
        method = read_method(preset, texts)
        self._tracker = build_tracker(method.tracker)
        embedders = [build_reid(method.reid)] if method.reid else []
        self._bus = MemoryBus([build_detector(method.detector), *embedders, self._tracker], False)
        self._cameras: dict[str, _Camera] = {}
        self._closed = False
        self.detections: Detections | None = None  # detections of the last frame
        self.people: Tracks | None = None  # last result of `process`

    def add_camera(
        self,
        name: str,
        intrinsics: Intrinsics | npt.ArrayLike,
        pose: npt.ArrayLike | None = None,
        parent: str = MAP,
        max_depth_m: float = 5.0,
    ) -> None:
        """Add a camera before its first frame.

        ConfigError if there is such a camera already; SourceError if name, intrinsics, pose or
        range are impossible.

        Args:
            name: Its name, for `process`.
            intrinsics: Lens of the colour image, or its camera matrix (3x3) without distortion.
            pose: Pose (4x4) of the optical frame (x right, y down, z forward) in `parent` [m], see
                `mount`; None: level at the origin.
            parent: "map", or the frame of a moving base with odometry by `add_motion`.
            max_depth_m: Larger readings of depth are not used [m].
        """
        if name in self._cameras:
            raise ConfigError(f"there is a camera {name!r} already", "Give it another name.")
        images = CameraImages(name, intrinsics, pose, parent, max_depth_m)
        self._cameras[name] = _Camera(images)

    def add_motion(self, message: Odometry | MovingTransform) -> None:
        """Add the motion of a base with cameras, before the frame at its time."""
        self._publish(message.stamp_ns, message)

    def process(
        self, rgb: U8, depth: npt.NDArray[Any], stamp_s: float | Fraction, camera: str = ""
    ) -> Tracks | None:
        """Return the people after a frame.

        ConfigError if there is no such camera; SourceError if the images are invalid, or the stamp
        is not in seconds or not later than the last one. Later frames are not affected.
        People4dError after `close`.

        Args:
            rgb: HxWx3 of 8 bits, red first.
            depth: HxW aligned to colour: uint16 millimetres or float metres; 0 or NaN: no reading.
            stamp_s: Acquisition time [s], of one clock for all cameras; a float has a resolution of
                0.25 us today, Fraction(stamp_ns, 10**9) is exact.
            camera: Its name; empty: the only one.

        Returns:
            The people with their identities; None if the frame is too late after another
            camera.
        """
        stamp_ns = _nanoseconds(stamp_s)
        outputs = self._publish(stamp_ns, *self._camera(camera).messages(rgb, depth, stamp_ns))
        outputs += self._tracker.flush(stamp_ns)  # the last message at this time
        self.detections = _last(Detections, outputs)
        self.people = _last(Tracks, outputs)
        return self.people

    def draw(self, rgb: U8) -> U8:
        """Return a copy of the last frame's colour (HxWx3) with drawn people."""
        return annotate(rgb, self.detections, self.people, None)

    def problems(self) -> list[str]:
        """Return the current limits of the pipeline, one sentence each."""
        return [reason for node in self._bus.nodes if (reason := node.status().reason)]

    def close(self) -> None:
        """Release the networks; later frames are refused."""
        self._closed = True
        for node in self._bus.nodes:
            node.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _: type[BaseException] | None, __: BaseException | None, ___: TracebackType | None
    ) -> None:
        self.close()

    def _camera(self, name: str) -> "_Camera":
        if name in self._cameras:
            return self._cameras[name]
        if not name and len(self._cameras) == 1:
            return next(iter(self._cameras.values()))
        known = ", ".join(self._cameras) or "none"
        raise ConfigError(f"unknown camera {name!r}; known: {known}", "Call add_camera before.")

    def _publish(self, now_ns: int, *messages: Message) -> list[Message]:
        """Return messages and all resulting messages; People4dError after `close`."""
        if self._closed:
            raise People4dError("the pipeline is closed", "Make a new Pipeline.")
        self._bus.now_ns = now_ns
        self._bus.log.clear()
        return self._bus.publish(*messages)


def _last(kind: type[M], messages: Sequence[Message]) -> M | None:
    return next((one for one in reversed(messages) if isinstance(one, kind)), None)


class _Camera:
    """Messages of a camera."""

    def __init__(self, images: CameraImages) -> None:
        self._images, self._turns = images, turns_of([images.transform], images.transform.child)
        self._sequence = 0

    def messages(self, rgb: U8, depth: npt.NDArray[Any], stamp_ns: int) -> list[Message]:
        """Return the message of a frame; before the first one calibration and pose."""
        first = self._images.info is None
        frame = self._images.accept(rgb, depth, stamp_ns)
        messages: list[Message] = self._calibration() if first else []
        message = RgbdFrame(
            stamp_ns=stamp_ns,
            sequence=self._sequence,
            camera=self._images.name,
            rgb=turned_image(frame.rgb, self._turns),
            depth_mm=turned_image(frame.depth_mm, self._turns),
        )
        self._sequence += 1
        return [*messages, message]

    def _calibration(self) -> list[Message]:
        info, pose = self._images.info, self._images.transform
        assert info is not None
        turned = turned_info(info, self._turns)
        return [turned, *turned_transforms([pose], info.frame_id, turned, self._turns)]


def _nanoseconds(stamp_s: float | Fraction) -> int:
    if isinstance(stamp_s, float | int | Fraction):
        stamp_ns = stamp_s * 10**9
        if -MAX_STAMP_NS <= stamp_ns <= MAX_STAMP_NS:
            return round(stamp_ns)
    problem = f"stamp_s: expected seconds, got {describe(stamp_s)}"
    raise SourceError(problem, "Of nanoseconds: Fraction(stamp_ns, 10**9).")


def _setting(name: str, value: object) -> str:
    return setting(name, value) if isinstance(value, str) else f"{name}={json.dumps(value)}"
