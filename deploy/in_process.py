"""The pipeline in memory, for programs that import it: see people4d_robot."""

import json
from collections import deque
from collections.abc import Mapping, Sequence
from fractions import Fraction
from types import TracebackType
from typing import Any, Self, TypeVar

import msgspec
import numpy as np
import numpy.typing as npt

from common.calibration.transforms_file import MAP
from common.config import setting
from common.diagnosis.camera_checks import REJECTED
from common.drawing.people import annotate
from common.geometry.transforms import LINK_FROM_OPTICAL, rotation_from_rpy, transform_from
from evaluation.methods import read_method
from evaluation.pipeline import pipeline
from people4d.errors import ConfigError, SourceError
from people4d.messages import (
    F64,
    U8,
    CameraInfo,
    Detections,
    Message,
    MovingTransform,
    Odometry,
    RgbdFrame,
    StaticTransform,
    Tracks,
)
from services.camera.calibration import Intrinsics, camera_info, static_transform, to_intrinsics
from services.camera.frame_check import FrameCheck
from services.camera.source import SourceFrame
from services.camera.upright import turned_image, turned_info, turned_transforms, turns_of

M = TypeVar("M", bound=Message)


def mount(
    x_m: float = 0.0,
    y_m: float = 0.0,
    z_m: float = 0.0,
    rpy_rad: Sequence[float] = (0.0, 0.0, 0.0),
) -> F64:
    """Return the pose (4x4) of a camera from where its body is and how it is turned.

    Args:
        x_m: Forward in the parent frame [m].
        y_m: To the left [m].
        z_m: Upward [m].
        rpy_rad: Roll, pitch and yaw [rad] of the body (x forward, y left, z up) about fixed axes;
            a positive pitch looks down.
    """
    return transform_from((x_m, y_m, z_m), rotation_from_rpy(*rpy_rad)) @ LINK_FROM_OPTICAL


class Pipeline:
    """Detector, re-identification and tracker joined in memory; the same input, the same people.

    Frames are processed in the calling thread, oldest first; a context manager, or `close` at the
    end.

    Args:
        preset: Method, as `people4d up --preset`; empty: the defaults.
        settings: Settings over those of the preset: {"tracker.max_range_m": 8.0}.

    Raises:
        ConfigError: The preset or a setting is unknown, or a value is out of range.
        ModelError: The file of a network is absent or altered.
    """

    def __init__(self, preset: str = "", settings: Mapping[str, Any] | None = None) -> None:
        texts = [_setting(name, value) for name, value in (settings or {}).items()]
        method = read_method(preset, texts)
        self._nodes = pipeline(method.detector, method.reid, method.tracker)
        self._cameras: dict[str, _Camera] = {}
        self.detections: Detections | None = None  # what `process` found in its last frame
        self.people: Tracks | None = None  # what it returned

    def add_camera(
        self,
        name: str,
        intrinsics: Intrinsics | npt.ArrayLike,
        pose: npt.ArrayLike | None = None,
        parent: str = MAP,
        max_depth_m: float = 5.0,
    ) -> None:
        """Add a camera before its first frame.

        Args:
            name: Its name, for `process`.
            intrinsics: Lens of the colour image, or its camera matrix (3x3) without distortion.
            pose: Pose (4x4) of the optical frame (x right, y down, z forward) in `parent` [m], see
                `mount`; None: level at the origin.
            parent: "map", or the frame of a moving base whose odometry `add_motion` gets.
            max_depth_m: Larger readings of depth are not used [m].

        Raises:
            ConfigError: There is such a camera already.
            SourceError: Intrinsics or pose are impossible.
        """
        if name in self._cameras:
            raise ConfigError(f"there is a camera {name!r} already", "Give it another name.")
        if not isinstance(intrinsics, Intrinsics):
            intrinsics = to_intrinsics(np.asarray(intrinsics, np.float64))
        matrix = mount() if pose is None else np.asarray(pose, np.float64)
        transform = static_transform(parent, f"{name}_optical_frame", matrix)
        self._cameras[name] = _Camera(name, intrinsics, transform, max_depth_m)

    def add_motion(self, message: Odometry | MovingTransform) -> None:
        """Take the motion of a base that carries cameras, before the frame of its time."""
        self._pass_on([message], message.stamp_ns)

    def process(
        self, rgb: U8, depth: npt.NDArray[Any], stamp_s: float | Fraction, camera: str = ""
    ) -> Tracks | None:
        """Return the people after a frame.

        Args:
            rgb: HxWx3 of 8 bits, red first.
            depth: HxW aligned to colour: uint16 millimetres or float metres; 0 or NaN: no reading.
            stamp_s: Acquisition time [s], of one clock for all cameras; a float of today keeps
                a quarter of a microsecond, Fraction(stamp_ns, 10**9) all.
            camera: Its name; empty: the only one.

        Returns:
            The people with their identities; None if another camera's frame came too long before.

        Raises:
            ConfigError: There is no such camera.
            SourceError: The images are not as they should be, or the stamp is not after the last.
        """
        frame = SourceFrame(rgb, depth, round(stamp_s * 10**9))
        outputs = self._pass_on(self._camera(camera).messages(frame), frame.stamp_ns)
        outputs += self._nodes[-1].flush(frame.stamp_ns)  # nothing else comes for this time
        self.detections = _last(Detections, outputs)
        self.people = _last(Tracks, outputs)
        return self.people

    def draw(self, rgb: U8) -> U8:
        """Return a copy of the last frame's colour (HxWx3) with its people drawn into it."""
        return annotate(rgb, self.detections, self.people, None)

    def problems(self) -> list[str]:
        """Return what limits the pipeline now, a sentence each."""
        return [reason for node in self._nodes if (reason := node.status().reason)]

    def close(self) -> None:
        """Release the networks."""
        for node in self._nodes:
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
        raise ConfigError(f"there is no camera {name!r} but {known}", "Call add_camera before.")

    def _pass_on(self, messages: Sequence[Message], now_ns: int) -> list[Message]:
        """Hand messages to the nodes, and what follows from them; return all that followed."""
        waiting, outputs = deque(messages), list[Message]()
        while waiting:
            message = waiting.popleft()
            for node in self._nodes:
                if isinstance(message, node.inputs):
                    following = node.handle(message, now_ns)
                    waiting.extend(following)
                    outputs.extend(following)
        return outputs


def _last(kind: type[M], messages: Sequence[Message]) -> M | None:
    return next((one for one in reversed(messages) if isinstance(one, kind)), None)


class _Camera:
    """Makes the messages of a camera, whose size its first frame gives."""

    def __init__(
        self, name: str, intrinsics: Intrinsics, transform: StaticTransform, max_depth_m: float
    ) -> None:
        self._name, self._intrinsics, self._transform = name, intrinsics, transform
        self._max_depth_m = max_depth_m
        self._turns = turns_of([transform], transform.child)
        self._info: CameraInfo | None = None  # of its images as they come
        self._sequence = 0
        self._stamp_ns: int | None = None  # of the last frame

    def messages(self, frame: SourceFrame) -> list[Message]:
        """Return the message of a frame; before the first one calibration and pose.

        Raises:
            SourceError: The images are not as they should be.
        """
        info = self._info or self._calibration(frame)
        check = FrameCheck(info, in_metres=_is_float(frame.depth_mm))
        accepted = check.accept(frame)
        if not isinstance(accepted, SourceFrame):
            raise SourceError(f"camera {self._name}: {check.fault}", REJECTED[check.cause])
        if self._stamp_ns is not None and frame.stamp_ns <= self._stamp_ns:
            ago_s = (self._stamp_ns - frame.stamp_ns) / 1e9
            problem = f"camera {self._name}: a frame is {ago_s:g} s older than the one before"
            raise SourceError(problem, "Give the oldest first; another recording, a new Pipeline.")
        self._stamp_ns = frame.stamp_ns
        messages: list[Message] = []
        if self._info is None:
            turned = turned_info(info, self._turns)
            poses = turned_transforms([self._transform], info.frame_id, turned, self._turns)
            messages, self._info = [turned, *poses], info
        message = RgbdFrame(
            stamp_ns=frame.stamp_ns,
            sequence=self._sequence,
            camera=self._name,
            # Copies, since velocities need the frame before.
            rgb=turned_image(accepted.rgb.copy(), self._turns),
            depth_mm=turned_image(accepted.depth_mm.copy(), self._turns),
        )
        self._sequence += 1
        return [*messages, message]

    def _calibration(self, frame: SourceFrame) -> CameraInfo:
        size = np.shape(frame.rgb)[:2]
        if len(size) != 2:
            raise SourceError(f"camera {self._name}: rgb is no image", "Give HxWx3, red first.")
        info = camera_info(self._intrinsics, (size[0], size[1]), self._transform.child)
        return msgspec.structs.replace(info, camera=self._name, max_depth_m=self._max_depth_m)


def _is_float(image: object) -> bool:
    return np.issubdtype(getattr(image, "dtype", np.uint16), np.floating)


def _setting(name: str, value: object) -> str:
    return setting(name, value) if isinstance(value, str) else f"{name}={json.dumps(value)}"
