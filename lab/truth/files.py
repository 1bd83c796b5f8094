"""Files with the truth of all frames, joined from files with some frames each."""

import math
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lab.drawing.renderer import DepthView, body_extents
from lab.truth.frames import PersonView
from lab.world import World
from people4d.errors import SourceError
from people4d.messages import CameraInfo

CONSTANT = ("K",)  # arrays that are equal in all parts; the others have a row for each frame
Arrays = dict[str, npt.NDArray[Any]]


def frame_arrays(world: World, index: int, people: Sequence[PersonView], view: DepthView) -> Arrays:
    """Return the arrays of `save_frames` for one frame with K people of `person_views`."""
    return {
        "t": np.array(world.frame_s(index)),
        "T_world_cam": world.map_from_optical(world.frame_s(index)),
        "pos": np.array([p.position_m for p in people]).reshape(-1, 3),
        "vel": np.array([p.velocity_mps for p in people]).reshape(-1, 3),
        "yaw": np.array([p.yaw_rad for p in people]),
        "path_yaw": np.array([p.path_yaw_rad for p in people]),
        "kp3d": np.array([p.keypoints_m for p in people], np.float32).reshape(-1, 17, 3),
        "kp2d": np.array([p.keypoints_px for p in people], np.float32).reshape(-1, 17, 2),
        "kpvis": np.array([p.visible for p in people], np.uint8).reshape(-1, 17),
        "bbox": np.array([p.box_xyxy_px for p in people], np.float32).reshape(-1, 4),
        "vis": np.array([p.visible_share for p in people], np.float32),
        "masks": view.owners,
        "stature": np.array([body.skeleton.stature_m for body in world.bodies], np.float32),
        "wheelchair": np.array([p.wheelchair for p in world.scenario.people], np.bool_),
        **_object_arrays(world, index),
    }


def _object_arrays(world: World, index: int) -> Arrays:
    """Return the arrays of M objects for one frame."""
    t_s, plans = world.frame_s(index), world.scenario.objects
    meshes, pose = [one.mesh(t_s) for one in world.objects], world.optical_from_map(t_s)
    boxes = [body_extents(mesh, pose, world.info).box_xyxy_px for mesh in meshes]
    poses = [(*plan.at, math.radians(plan.yaw_deg)) for plan in plans]
    return {
        "object_kind": np.array([plan.kind for plan in plans], "U9"),
        "object_pose": np.array(poses).reshape(-1, 3),
        "object_bbox": np.array(boxes, np.float32).reshape(-1, 4),
    }


def save_frames(path: Path, info: CameraInfo, frames: Sequence[Arrays]) -> None:
    """Write the truth of N frames with K people, of `frame_arrays`, as an NPZ file.

    Arrays; 3D points are in the map, NaN means unknown:

    - K: 4, fx, fy, cx, cy in pixels
    - t: N, time since the start of the scenario, s
    - T_world_cam: Nx4x4, map_from_optical
    - pos, vel: NxKx3, position and velocity of the torso, m and m/s
    - yaw, path_yaw: NxK, yaw of chest and path, rad
    - kp3d: NxKx17x3, keypoints in COCO order, m
    - kp2d: NxKx17x2, keypoints in pixels
    - kpvis: NxKx17, 1: in the image and not occluded
    - bbox: NxKx4, box of the unoccluded body, xyxy in pixels
    - vis: NxK, unoccluded share of the body's pixels
    - masks: NxHxW, 0: no person, k: person k, counted from 1
    - stature: NxK, with shoes, m
    - wheelchair: NxK, True: in a wheelchair
    - object_kind: NxM, kind of each object that looks like a person
    - object_pose: NxMx3, x and y in m, yaw in rad
    - object_bbox: NxMx4, box of the unoccluded object, xyxy in pixels
    """
    lens = np.array([info.fx, info.fy, info.cx, info.cy])
    stacked = {name: np.stack([frame[name] for frame in frames]) for name in frames[0]}
    np.savez_compressed(path, K=lens, **stacked)  # type: ignore[arg-type]


def join_frames(path: Path, parts: Sequence[Path]) -> None:
    """Join files of `save_frames` in order, one in memory at a time; or SourceError."""
    with np.load(parts[0]) as first:
        names = list(first)
    try:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in names:
                _join(archive, name, parts[:1] if name in CONSTANT else parts)
    except OSError as error:
        raise SourceError(f"truth {path} cannot be written: {error.strerror}") from error


def _join(archive: zipfile.ZipFile, name: str, parts: Sequence[Path]) -> None:
    shapes, kinds = zip(*(_form(part, name) for part in parts), strict=True)
    header = {
        "descr": np.lib.format.dtype_to_descr(kinds[0]),
        "fortran_order": False,
        "shape": (sum(shape[0] for shape in shapes), *shapes[0][1:]),
    }
    # The default date of an entry is the time of writing.
    entry = zipfile.ZipInfo(f"{name}.npy")
    entry.compress_type = zipfile.ZIP_DEFLATED
    with archive.open(entry, "w", force_zip64=True) as file:
        np.lib.format.write_array_header_1_0(file, header)
        for part in parts:
            with np.load(part) as arrays:
                file.write(np.ascontiguousarray(arrays[name]).tobytes())


def _form(part: Path, name: str) -> tuple[tuple[int, ...], np.dtype[np.generic]]:
    with np.load(part) as arrays:
        array = arrays[name]
    return array.shape, array.dtype
