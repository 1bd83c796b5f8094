"""What is true about the people in one frame, for tests of what sees them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from common.geometry import apply, project
from common.messages import F64, CameraInfo
from services.camera.lab.mesh import Mesh
from services.camera.lab.renderer import Extent, body_extents
from services.camera.lab.truth import capture, person_id, velocity_mps
from services.camera.lab.views import DepthView, PersonView
from services.camera.lab.world import World

NEAR_M = 0.1  # points nearer to the camera's plane have no pixel
INSIDE_M = 0.16  # joints lie this deep inside the body, seen from where nothing hides them
BEFORE_M = 0.02  # other things hide a point when they are nearer by more than this

Arrays = dict[str, npt.NDArray[Any]]


def person_views(
    world: World, t_s: float, view: DepthView | None, meshes: Sequence[Mesh] | None = None
) -> tuple[PersonView, ...]:
    """Return the truth about each person in a frame, in the order of the scenario.

    Args:
        world: What is before the camera.
        t_s: Time of the frame.
        view: What the camera sees then. Without it nothing is hidden and boxes are those of the
            keypoints, which takes no drawing.
        meshes: The bodies at that time, if they are at hand.
    """
    if view is not None and meshes is None:
        meshes = world.meshes(t_s)
    return tuple(
        _person_view(world, t_s, k, view, meshes[k] if meshes else None)
        for k in range(len(world.bodies))
    )


def _person_view(
    world: World, t_s: float, k: int, view: DepthView | None, mesh: Mesh | None
) -> PersonView:
    optical_from_map = world.optical_from_map(t_s)
    keypoints_m = world.bodies[k].keypoints_m(world.motions[k].at(t_s))
    points_m = apply(optical_from_map, keypoints_m)
    pixels = project_visible(points_m, world.info)
    inside = in_image(pixels, world.info)
    if view is None or mesh is None:
        visible, box, share = inside, _around(pixels, world.info), float(inside.any())
    else:
        visible = inside & ~hidden(pixels, points_m[:, 2], view, k + 1, inside)
        extent = body_extents(mesh, optical_from_map, world.info)
        box, share = extent.box_xyxy_px, _share(view, k + 1, extent)
    now = capture(world, k, t_s)
    return PersonView(
        id=person_id(k),
        position_m=now.position_m,
        velocity_mps=velocity_mps(world, k, t_s),
        yaw_rad=now.yaw_rad,
        path_yaw_rad=now.path_yaw_rad,
        keypoints_m=keypoints_m,
        keypoints_px=pixels,
        visible=visible.astype(np.uint8),
        box_xyxy_px=box,
        visible_share=share,
    )


def project_visible(points_m: F64, info: CameraInfo) -> F64:
    """Return Nx2 pixels of Nx3 points of the optical frame; NaN behind the camera."""
    before = points_m[:, 2] > NEAR_M
    pixels = np.full((len(points_m), 2), np.nan)
    pixels[before] = project(points_m[before], info)
    return pixels


def in_image(pixels: F64, info: CameraInfo) -> npt.NDArray[np.bool_]:
    """Tell which of Nx2 pixels are in the image, whose pixels have whole numbers as centres."""
    inside = (pixels > -0.5) & (pixels < (info.width - 0.5, info.height - 0.5))
    return np.asarray(inside.all(axis=1))


def hidden(
    pixels: F64, depth_m: F64, view: DepthView, owner: int, inside: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """Tell which points of a body something hides, its own limbs included.

    Args:
        pixels: Nx2.
        depth_m: N, of the points.
        view: What the camera sees.
        owner: Number of the body.
        inside: N, whether the pixel is in the image; others count as hidden.
    """
    column, row = np.rint(np.where(inside[:, None], pixels, 0)).astype(int).T
    depth_there = view.depth_m[row, column]
    allowed_m = np.where(view.owners[row, column] == owner, INSIDE_M, BEFORE_M)
    return np.asarray(~inside | (depth_there < depth_m - allowed_m))


def _share(view: DepthView, owner: int, extent: Extent) -> float:
    if not extent.pixels:
        return 0.0
    return min(1.0, int(np.count_nonzero(view.owners == owner)) / extent.pixels)


def _around(pixels: F64, info: CameraInfo) -> F64:
    """Return the box of the pixels, cut to the image; NaN if it lies outside."""
    known = pixels[np.isfinite(pixels[:, 0])]
    if not len(known):
        return np.full(4, np.nan)
    low = np.maximum(known.min(axis=0), 0)
    high = np.minimum(known.max(axis=0), (info.width, info.height))
    return np.concatenate([low, high]) if np.all(low < high) else np.full(4, np.nan)


def frame_arrays(world: World, index: int, people: Sequence[PersonView], view: DepthView) -> Arrays:
    """Return the truth of one frame as arrays, to be stacked by `save_frames`.

    Args:
        world: What is before the camera.
        index: Of the frame.
        people: K, from `person_views`.
        view: What the camera sees.
    """
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
    """Write the truth of N frames with K people as an NPZ file.

    Its arrays are the following; the map is the frame of 3D points, NaN stands for unknown.

    - K: 4, fx, fy, cx, cy in pixels
    - t: N, seconds since the beginning of the scenario
    - T_world_cam: Nx4x4, map_from_optical
    - pos, vel: NxKx3, torso and its derivative, m and m/s
    - yaw, path_yaw: NxK, of the chest and of the way, rad
    - kp3d: NxKx17x3, COCO's keypoints, m
    - kp2d: NxKx17x2, the same in pixels
    - kpvis: NxKx17, 1 = in the image and not hidden
    - bbox: NxKx4, xyxy in pixels of the body as if nothing hid it
    - vis: NxK, share of its pixels that nothing hides
    - masks: NxHxW, 0 = no person, k = person k, counted from 1

    Args:
        path: Of the file.
        info: Calibration.
        frames: From `frame_arrays`, by rising time; at least one.
    """
    lens = np.array([info.fx, info.fy, info.cx, info.cy])
    stacked = {name: np.stack([frame[name] for frame in frames]) for name in frames[0]}
    np.savez_compressed(path, K=lens, **stacked)  # type: ignore[arg-type]
