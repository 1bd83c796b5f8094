"""Files with the truth of all frames, joined from those of some frames each."""

import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lab.drawing.renderer import DepthView
from lab.truth.frames import PersonView
from lab.world import World
from people4d.errors import SourceError
from people4d.messages import CameraInfo

CONSTANT = ("K",)  # arrays that are the same in all parts; the others have a row for each frame
Arrays = dict[str, npt.NDArray[Any]]


def frame_arrays(world: World, index: int, people: Sequence[PersonView], view: DepthView) -> Arrays:
    """Return the truth of one frame with K people, from `person_views`, for `save_frames`."""
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
    }


def save_frames(path: Path, info: CameraInfo, frames: Sequence[Arrays]) -> None:
    """Write the truth of N frames with K people, from `frame_arrays`, as an NPZ file.

    Its arrays are the following; the map is the frame of 3D points, NaN stands for unknown.

    - K: 4, fx, fy, cx, cy in pixels
    - t: N, seconds since the beginning of the scenario
    - T_world_cam: Nx4x4, map_from_optical
    - pos, vel: NxKx3, torso and its derivative, m and m/s
    - yaw, path_yaw: NxK, of the chest and of the path, rad
    - kp3d: NxKx17x3, COCO's keypoints, m
    - kp2d: NxKx17x2, the same in pixels
    - kpvis: NxKx17, 1 = in the image and not hidden
    - bbox: NxKx4, xyxy in pixels of the body as if nothing hid it
    - vis: NxK, share of its pixels that nothing hides
    - masks: NxHxW, 0 = no person, k = person k, counted from 1
    """
    lens = np.array([info.fx, info.fy, info.cx, info.cy])
    stacked = {name: np.stack([frame[name] for frame in frames]) for name in frames[0]}
    np.savez_compressed(path, K=lens, **stacked)  # type: ignore[arg-type]


def join_frames(path: Path, parts: Sequence[Path]) -> None:
    """Join files of `save_frames`, at least one, by their order; one is in memory at a time.

    Raises:
        SourceError: The file cannot be written.
    """
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
