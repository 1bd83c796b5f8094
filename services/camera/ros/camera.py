"""Camera of a bag: calibration, mount, and registration of depth."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from common.config import Config
from common.io.ros_bag import Bag
from people4d.errors import DecodeError, SourceError
from people4d.messages import U8, U16, CameraInfo, StaticTransform
from services.camera.calibration import (
    Calibration,
    Intrinsics,
    MatNames,
    camera_info,
    read_calibration,
    registration,
    static_transform,
)
from services.camera.folder.registration import Registration
from services.camera.ros.calibration import TransformTree, intrinsics_of
from services.camera.ros.images import colour_image, depth_image
from services.camera.ros.motion import JointConfig
from services.camera.ros.topics import Topics
from services.camera.ros.types import OLD_TF, TF

TF_HEADS = 2000  # messages of /tf that are searched for moving transforms: some ten seconds
MAX_BAD_HEADS = 30  # corrupt images after which a topic is unusable: one second


class RosbagOptions(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Options of a bag; empty topics are found by type and name."""

    colour_topic: str = ""  # Image, CompressedImage or realsense2_camera_msgs/RGBD
    depth_topic: str = ""  # Image or CompressedImage; 16UC1 in mm or 32FC1 in m
    colour_info_topic: str = ""  # CameraInfo of colour
    depth_info_topic: str = ""  # CameraInfo of depth, for depth that is not aligned
    odometry_topic: str = ""  # nav_msgs/Odometry; found if there is one
    sync_slop_s: float = 0.5  # [s] largest distance in time of colour and depth
    map_frame: str = "map"  # frame of the bag that is renamed to `map`
    tf_as_static: bool = False  # True: take /tf as static too (a camera that never moves)
    # Wheels of a base without odometry: sensor_msgs/JointState, or a topic of a number
    # (std_msgs) for the left wheel and one for the right
    wheel_topics: tuple[str, ...] = ()
    wheels: JointConfig = JointConfig()
    depth_aligned: bool | None = None  # None: found from frames, sizes and calibration
    depth_offset_px: tuple[float, float] = (0.0, 0.0)  # [px] u, v, see Registration
    calibration: str = ""  # calibration file that is used instead of CameraInfo


@dataclass(frozen=True)
class CameraMount:
    """Mount of a camera in the map or on the base."""

    transforms: list[StaticTransform]  # static ones
    moving: tuple[tuple[str, str], ...] = ()  # parent and child of the moving ones in /tf


@dataclass(frozen=True)
class RosCamera:
    """The camera of a bag."""

    info: CameraInfo  # calibration of colour
    mount: CameraMount  # its mount
    # moves depth into the view of colour; None if it is there already
    registration: Registration | None


@dataclass(frozen=True)
class _Head:
    """The first image of a stream: its size (height, width), frame and CameraInfo."""

    size: tuple[int, int]
    frame: str
    info: Any | None


def read_camera(bag: Bag, topics: Topics, options: RosbagOptions) -> RosCamera:
    """Read calibration and transforms of a bag.

    Raises:
        SourceError: There is no usable calibration, or depth can neither be taken as aligned
            nor be registered.
    """
    colour, depth = _heads(bag, topics)
    tree = _tree(bag, options.tf_as_static)
    calibration = _calibration(topics, options, tree, (colour, depth))
    if calibration.colour is None:
        raise SourceError(f"calibration {options.calibration} has no colour camera")
    info = camera_info(calibration.colour, colour.size, colour.frame)
    register = registration(calibration, info, depth.size)
    if register is None and depth.size != colour.size:
        raise SourceError(f"depth is {depth.size}, colour {colour.size}: it cannot be aligned")
    if not options.tf_as_static:
        _add_moving(bag, tree)
    base = _base(bag, topics, options)
    mount = _moving_mount(tree, colour.frame, base, options) or _static_mount(
        tree, colour.frame, base, options
    )
    return RosCamera(info, mount, register)


def _heads(bag: Bag, topics: Topics) -> tuple[_Head, _Head]:
    if topics.colour == topics.depth:
        rgbd = bag.first(topics.colour)
        return (
            _Head(_size(colour_image, rgbd.rgb), _frame(rgbd.rgb), rgbd.rgb_camera_info),
            _Head(_size(depth_image, rgbd.depth), _frame(rgbd.depth), rgbd.depth_camera_info),
        )
    return (
        _head(bag, topics.colour, topics.colour_info, colour_image),
        _head(bag, topics.depth, topics.depth_info, depth_image),
    )


def _head(bag: Bag, topic: str, info_topic: str, decode: Callable[[Any], U8 | U16]) -> _Head:
    reason = "it is empty"
    for _, _, message in islice(bag.messages([topic]), MAX_BAD_HEADS):
        try:
            size = _size(decode, message)
        except DecodeError as error:
            reason = error.problem
            continue
        return _Head(size, _frame(message), bag.first(info_topic) if info_topic else None)
    raise SourceError(f"{topic} has no readable image: {reason}")


def _size(decode: Callable[[Any], U8 | U16], message: Any) -> tuple[int, int]:
    height, width = decode(message).shape[:2]
    return height, width


def _frame(message: Any) -> str:
    return str(message.header.frame_id).strip("/")


def _tree(bag: Bag, tf_as_static: bool) -> TransformTree:
    tree = TransformTree()
    wanted = [
        topic
        for topic, kind in bag.types.items()
        if kind in (TF, OLD_TF) and (tf_as_static or topic.endswith("tf_static"))
    ]
    for _, _, message in bag.messages(wanted):
        tree.add(message)
    return tree


def _calibration(
    topics: Topics, options: RosbagOptions, tree: TransformTree, heads: tuple[_Head, _Head]
) -> Calibration:
    """Gather the calibration, with that of depth only where depth has to be registered."""
    if options.calibration:
        return read_calibration(Path(options.calibration), MatNames())
    colour, depth = heads
    if colour.info is None:
        raise SourceError(
            f"bag has no calibration (CameraInfo) for {topics.colour}",
            "Set options.colour_info_topic, or options.calibration to a file.",
        )
    intrinsics = intrinsics_of(colour.info, rectified="image_rect" in topics.colour)
    depth_intrinsics = None
    if depth.info is not None:
        depth_intrinsics = intrinsics_of(depth.info, rectified="image_rect" in topics.depth)
    if _aligned(options, heads, (intrinsics, depth_intrinsics)):
        return Calibration(colour=intrinsics)
    matrix = tree.find(colour.frame, depth.frame)
    if depth_intrinsics is None or matrix is None:
        missing = "CameraInfo of depth" if depth_intrinsics is None else "transform between them"
        raise SourceError(
            f"depth (frame {depth.frame}) is not aligned to colour (frame {colour.frame}) and "
            f"the bag has no {missing}",
            "Set options.depth_aligned=true if it is, or options.calibration to a file.",
        )
    return Calibration(
        colour=intrinsics,
        depth=depth_intrinsics,
        rotation=tuple(tuple(row) for row in matrix[:3, :3].tolist()),
        translation_m=tuple(matrix[:3, 3].tolist()),
        depth_offset_px=options.depth_offset_px,
    )


def _aligned(
    options: RosbagOptions,
    heads: tuple[_Head, _Head],
    intrinsics: tuple[Intrinsics, Intrinsics | None],
) -> bool:
    """Depth is aligned if it has the size of colour, and its frame or its calibration too."""
    if options.depth_aligned is not None:
        return options.depth_aligned
    (colour, depth), (colour_intrinsics, depth_intrinsics) = heads, intrinsics
    if colour.size != depth.size:
        return False
    if depth_intrinsics is None:
        return colour.frame == depth.frame
    ours, theirs = (
        (one.fx, one.fy, one.cx, one.cy) for one in (colour_intrinsics, depth_intrinsics)
    )
    # Two sensors never share a calibration to a hundredth of a pixel.
    return colour.frame == depth.frame or bool(np.allclose(ours, theirs, atol=0.01, rtol=0))


def _add_moving(bag: Bag, tree: TransformTree) -> None:
    wanted = [
        topic
        for topic, kind in bag.types.items()
        if kind in (TF, OLD_TF) and not topic.endswith("tf_static")
    ]
    for _, _, message in islice(bag.messages(wanted), TF_HEADS):
        tree.add_moving(message)


def _base(bag: Bag, topics: Topics, options: RosbagOptions) -> tuple[str, str] | None:
    """Return the frames of odometry: that of the pose and that of the base."""
    if options.wheel_topics:
        return options.wheels.frame_id, options.wheels.child_frame_id
    if not (topics.odometry and bag.counts[topics.odometry]):
        return None
    odometry = bag.first(topics.odometry)
    return odometry.header.frame_id.strip("/"), odometry.child_frame_id.strip("/")


def _moving_mount(
    tree: TransformTree, optical: str, base: tuple[str, str] | None, options: RosbagOptions
) -> CameraMount | None:
    """Return the path from the camera to the map, else to the base, else to the root of /tf.

    Returns:
        None if nothing on that path moves beside odometry.
    """
    path = tree.climb(optical)
    frames = [parent for parent, _, _ in path]
    if options.map_frame in frames:
        path = path[: frames.index(options.map_frame) + 1]
    elif base and base[1] in frames:
        path = path[: frames.index(base[1]) + 1]
    moving = [(parent, child) for parent, child, matrix in path if matrix is None]
    moving = [edge for edge in moving if edge != base]
    if not moving:
        return None
    names = {options.map_frame: "map"}
    static = [
        static_transform(names.get(parent, parent), child, matrix)
        for parent, child, matrix in path
        if matrix is not None
    ]
    return CameraMount(static, tuple(moving))


def _static_mount(
    tree: TransformTree, optical: str, base: tuple[str, str] | None, options: RosbagOptions
) -> CameraMount:
    """Return the mount in the map, else on the base of odometry."""
    parents = {options.map_frame: "map"}
    if base:
        parents[base[1]] = base[1]
    for frame, name in parents.items():
        matrix = tree.find(frame, optical)
        if matrix is not None:
            return CameraMount([static_transform(name, optical, matrix)])
    return CameraMount([])
