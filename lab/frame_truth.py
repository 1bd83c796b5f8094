"""What is true about the people in one frame, for tests of what sees them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from common.geometry.transforms import apply, project
from lab.drawing.mesh import Mesh
from lab.drawing.renderer import body_extents
from lab.outline import Outline, outlines
from lab.truth import capture, person_id, velocity_mps
from lab.views import DepthView, PersonView
from lab.world import World
from people4d.messages import F64, CameraInfo

NEAR_M = 0.1  # points nearer to the camera's plane have no pixel
# [m] how deep keypoints (COCO order) may lie behind the skin or cloth in front of them: a little
# more than the greatest depths of twelve people seen from the sides where their own body does not
# hide the point, less than where it does.
NOSE, EYE, EAR, SHOULDER, ELBOW, WRIST = 0.04, 0.04, 0.05, 0.12, 0.08, 0.065
HIP, KNEE, ANKLE = 0.16, 0.11, 0.09
PAIRS = (EYE, EAR, SHOULDER, ELBOW, WRIST, HIP, KNEE, ANKLE)
INSIDE_M: F64 = np.array([NOSE, *np.repeat(PAIRS, 2)])
BEFORE_M = 0.02  # other things hide a point when they are nearer by more than this

Arrays = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class _Seen:
    """What of a person is seen; fields as in `PersonView`."""

    visible: npt.NDArray[np.bool_]
    box_xyxy_px: F64
    share: float


def person_views(
    world: World, t_s: float, view: DepthView | None, meshes: Sequence[Mesh] | None = None
) -> tuple[PersonView, ...]:
    """Return the truth about each person in a frame, in the order of the scenario.

    Args:
        world: What is before the camera.
        t_s: Time of the frame.
        view: What the camera sees then. Without it, which takes no drawing, only people hide
            people, and bodies are capsules about their keypoints, see `outline`.
        meshes: The bodies at that time, if they are at hand.
    """
    optical_from_map = world.optical_from_map(t_s)
    keypoints = world.keypoints_m(t_s)
    if view is None:
        found = outlines(keypoints, optical_from_map, world.info)
        seen = [_outlined(found.get(k), world.info) for k in range(len(keypoints))]
    else:
        meshes = world.meshes(t_s) if meshes is None else meshes
        pairs = zip(keypoints, meshes, strict=True)
        seen = [_drawn(points, mesh, view, optical_from_map, world.info) for points, mesh in pairs]
    return tuple(_person_view(world, t_s, k, points, seen[k]) for k, points in enumerate(keypoints))


def _person_view(world: World, t_s: float, k: int, keypoints_m: F64, seen: _Seen) -> PersonView:
    now = capture(world, k, t_s)
    points_m = apply(world.optical_from_map(t_s), keypoints_m)
    return PersonView(
        id=person_id(k),
        position_m=now.position_m,
        velocity_mps=velocity_mps(world, k, t_s),
        yaw_rad=now.yaw_rad,
        path_yaw_rad=now.path_yaw_rad,
        keypoints_m=keypoints_m,
        keypoints_px=project_visible(points_m, world.info),
        visible=seen.visible.astype(np.uint8),
        box_xyxy_px=seen.box_xyxy_px,
        visible_share=seen.share,
    )


def _drawn(
    keypoints_m: F64, mesh: Mesh, view: DepthView, optical_from_map: F64, info: CameraInfo
) -> _Seen:
    """Return what an image shows of a body."""
    points_m = apply(optical_from_map, keypoints_m)
    pixels = project_visible(points_m, info)
    visible = in_image(pixels, info)
    owner = int(mesh.owner[0])
    visible[visible] &= ~hidden(
        pixels[visible], points_m[visible, 2], view, owner, INSIDE_M[visible]
    )
    extent = body_extents(mesh, optical_from_map, info)
    pixels_seen = int(np.count_nonzero(view.owners == owner))
    share = min(1.0, pixels_seen / extent.pixels) if extent.pixels else 0.0
    return _Seen(visible, extent.box_xyxy_px, share)


def _outlined(outline: Outline | None, info: CameraInfo) -> _Seen:
    """Return what is seen of a body of capsules."""
    box = np.full(4, np.nan)
    if outline is None:
        return _Seen(np.zeros(17, np.bool_), box, 0.0)
    cut = outline.box_xyxy_px.clip(0, [info.width, info.height] * 2)
    if np.all(cut[:2] < cut[2:]):
        box = cut
    return _Seen(outline.visible, box, outline.visible_share)


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
    pixels: F64, depth_m: F64, view: DepthView, owner: int, inside_m: F64
) -> npt.NDArray[np.bool_]:
    """Tell which points of a body something hides, its own limbs included.

    Args:
        pixels: Nx2, in the image.
        depth_m: N, of the points.
        view: What the camera sees.
        owner: Number of the body.
        inside_m: N, how deep each point may lie behind the body's surface.
    """
    column, row = np.rint(pixels).astype(int).T
    allowed_m = np.where(view.owners[row, column] == owner, inside_m, BEFORE_M)
    return np.asarray(view.depth_m[row, column] < depth_m - allowed_m)


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
