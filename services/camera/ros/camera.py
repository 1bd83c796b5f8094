"""Camera of a bag: calibration, mount, and registration of depth."""

from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from common.config import Config
from common.geometry.transforms import invert
from common.geometry.wheel_odometry import WheelConfig
from common.io.ros_bag import Bag
from common.ros2.transforms import edges_of, matrix_of
from people4d.errors import SourceError
from people4d.messages import F64, StaticTransform
from services.camera.alignment import ImageAlignment, align
from services.camera.calibration import Calibration, Intrinsics, read_calibration, static_transform
from services.camera.ros.camera_info import intrinsics_of
from services.camera.ros.heads import ImageHead, read_heads
from services.camera.ros.motion import FrameTree
from services.camera.ros.topics import OLD_TF, SDK_TF, TF, TRANSFORM, Topics

TF_HEADS = 2000  # number of messages of /tf searched for moving transforms: about ten seconds


class RosbagOptions(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Options of a bag; empty topics are found by type and name."""

    colour_topic: str = ""  # Image, CompressedImage or realsense2_camera_msgs/RGBD
    depth_topic: str = ""  # Image or CompressedImage; 16UC1 in mm or 32FC1 in m
    colour_info_topic: str = ""  # CameraInfo of colour
    depth_info_topic: str = ""  # CameraInfo of unaligned depth
    odometry_topic: str = ""  # nav_msgs/Odometry; found if there is one
    sync_slop_s: float = 0.5  # [s] maximum distance in time of colour and depth
    map_frame: str = "map"  # frame of the bag that is renamed to `map`
    tf_as_static: bool = False  # True: transforms of /tf are static, too
    # Wheels of a base without odometry: sensor_msgs/JointState, or a topic of a number
    # (std_msgs) for the left wheel and one for the right
    wheel_topics: tuple[str, ...] = ()
    wheels: WheelConfig = WheelConfig()
    depth_aligned: bool | None = None  # alignment; absent: found by frames, sizes, calibration
    depth_offset_px: tuple[float, float] = (0.0, 0.0)  # [px] u, v, see Registration
    calibration: str = ""  # calibration file used instead of CameraInfo


@dataclass(frozen=True)
class RosCamera:
    """The camera of a bag, and its mount in the map or on the base."""

    alignment: ImageAlignment  # steps to aligned images, and their calibration
    transforms: list[StaticTransform]
    moving: frozenset[tuple[str, str]]  # parent and child of the moving transforms in /tf


def read_camera(bag: Bag, topics: Topics, options: RosbagOptions) -> RosCamera:
    """Read calibration and mount of a bag; SourceError if depth is not aligned and cannot be."""
    tree, heads = _tree(bag, options.tf_as_static), read_heads(bag, topics)
    _fix_constant(bag, tree, {head.frame for head in heads})
    return make_camera(topics, options, heads, tree, _base(bag, topics, options))


def make_camera(
    topics: Topics,
    options: RosbagOptions,
    heads: tuple[ImageHead, ImageHead],
    tree: FrameTree,
    base: tuple[str, str] | None,
) -> RosCamera:
    """Combine calibration and mount.

    SourceError if there is no usable calibration, or depth is not aligned and cannot be.

    Args:
        topics: Topics that are played.
        options: Options of the source.
        heads: First images of colour and of depth.
        tree: Coordinate frames.
        base: Frames of odometry: its reference frame and its base frame.
    """
    colour, depth = heads
    calibration = _calibration(topics, options, tree, heads)
    if calibration.colour is None:
        raise SourceError(f"calibration {options.calibration} has no colour camera")
    alignment = align(calibration, calibration.colour, colour.size, depth.size, colour.frame)
    path = _path(tree, colour.frame, base, options)
    moving = frozenset((parent, child) for parent, child, matrix in path if matrix is None)
    moving -= {base}
    if not moving:
        mount = _static_mount(tree, colour.frame, base, options)
        return RosCamera(alignment, mount, moving)
    transforms = [
        static_transform("map" if parent == options.map_frame else parent, child, matrix)
        for parent, child, matrix in path
        if matrix is not None
    ]
    return RosCamera(alignment, transforms, moving)


def _tree(bag: Bag, tf_as_static: bool) -> FrameTree:
    tree = FrameTree()
    topics = {topic for topic, kind in bag.types.items() if kind in (TF, OLD_TF)}
    static = {topic for topic in topics if tf_as_static or topic.endswith("tf_static")}
    for _, _, message in bag.messages(static):
        for edge in edges_of(message):
            tree.add_transform(edge.parent, edge.child, edge.matrix)
    for _, _, message in islice(bag.messages(topics - static), TF_HEADS):
        for edge in edges_of(message):
            tree.add_transform(edge.parent, edge.child)
    for topic, kind in bag.types.items():
        if kind == TRANSFORM and topic.endswith(SDK_TF):
            for matrix in (matrix_of(message) for _, _, message in bag.messages([topic])):
                if matrix is not None:
                    stream = topic.removesuffix(SDK_TF).strip("/")
                    tree.add_transform(stream.partition("/")[0], stream, invert(matrix))
    return tree


def _fix_constant(bag: Bag, tree: FrameTree, frames: set[str]) -> None:
    """Make transforms static that static_transform_publisher of ROS 1 repeats in /tf."""
    paths = [[(parent, child) for parent, child, _ in tree.path(frame)] for frame in frames]
    if len(paths) < 2 or not all(paths) or paths[0][-1][0] != paths[1][-1][0]:
        return  # both in one frame, or in separate trees
    wanted = {edge for edge in {*paths[0]} ^ {*paths[1]} if tree.find_transform(*edge) is None}
    if not wanted:
        return
    found: dict[tuple[str, str], F64 | None] = {}
    topics = {topic for topic, kind in bag.types.items() if kind in (TF, OLD_TF)}
    for _, _, message in bag.messages(topics):
        for edge in edges_of(message):
            names = edge.parent, edge.child
            before = found.setdefault(names, edge.matrix)
            if before is not None and not np.allclose(before, edge.matrix, atol=1e-6, rtol=0):
                found[names] = None
    for parent, child in wanted:
        tree.add_transform(parent, child, found.get((parent, child)))


def _calibration(
    topics: Topics, options: RosbagOptions, tree: FrameTree, heads: tuple[ImageHead, ImageHead]
) -> Calibration:
    if options.calibration:
        return read_calibration(Path(options.calibration))
    colour, depth = heads
    if colour.info is None:
        raise SourceError(
            f"there is no calibration (CameraInfo) for {topics.colour}",
            "Set options.colour_info_topic, or options.calibration to a file.",
        )
    intrinsics = intrinsics_of(colour.info, topics.colour)
    depth_intrinsics = None
    if depth.info is not None:
        depth_intrinsics = intrinsics_of(depth.info, topics.depth)
    if _aligned(options, heads, (intrinsics, depth_intrinsics)):
        return Calibration(colour=intrinsics)
    matrix = tree.find_transform(colour.frame, depth.frame)
    if depth_intrinsics is None or matrix is None:
        missing = "CameraInfo of depth" if depth_intrinsics is None else "transform between them"
        raise SourceError(
            f"depth (frame {depth.frame}) is not aligned to colour (frame {colour.frame}) and "
            f"there is no {missing}",
            "Set options.depth_aligned=true if it is, options.tf_as_static=true if /tf has the "
            "transform, or options.calibration to a file.",
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
    heads: tuple[ImageHead, ImageHead],
    intrinsics: tuple[Intrinsics, Intrinsics | None],
) -> bool:
    """Return True if depth has the size and calibration of colour, or without one its frame."""
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
    # Calibrations of two sensors always differ by more than 0.01 px, while some drivers use one
    # frame for both.
    return bool(np.allclose(ours, theirs, atol=0.01, rtol=0))


def _base(bag: Bag, topics: Topics, options: RosbagOptions) -> tuple[str, str] | None:
    """Return the frames of odometry: its reference frame and its base frame."""
    if options.wheel_topics:
        return options.wheels.frame_id, options.wheels.child_frame_id
    if not (topics.odometry and bag.counts[topics.odometry]):
        return None
    odometry = bag.first(topics.odometry)
    return odometry.header.frame_id.strip("/"), odometry.child_frame_id.strip("/")


def _path(
    tree: FrameTree, optical: str, base: tuple[str, str] | None, options: RosbagOptions
) -> list[tuple[str, str, F64 | None]]:
    """Return the path from the camera to the map, else to the base, else to the root of /tf.

    A matrix is None for a moving transform; consecutive static ones are combined.
    """
    path: list[tuple[str, str, F64 | None]] = []
    for parent, child, matrix in tree.path(optical):
        _, first, below = path[-1] if path else ("", "", None)
        if matrix is not None and below is not None:
            path[-1] = parent, first, matrix @ below
        else:
            path.append((parent, child, matrix))
    frames = [parent for parent, _, _ in path]
    for end in (options.map_frame, base[1] if base else ""):
        if end in frames:
            return path[: frames.index(end) + 1]
    return path


def _static_mount(
    tree: FrameTree, optical: str, base: tuple[str, str] | None, options: RosbagOptions
) -> list[StaticTransform]:
    """Return the mount in the map, else on the base of odometry."""
    parents = {options.map_frame: "map"}
    if base:
        parents[base[1]] = base[1]
    for frame, name in parents.items():
        matrix = tree.find_transform(frame, optical)
        if matrix is not None:
            return [static_transform(name, optical, matrix)]
    return []
