"""Ground truth of the people in one frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common.geometry.transforms import apply, project
from lab.drawing.mesh import Mesh
from lab.drawing.renderer import DepthView, body_extents
from lab.truth.motion_capture import capture, person_id, velocity_mps
from lab.world import World
from people4d.messages import F32, F64, U8, CameraInfo

NEAR_M = 0.1  # minimum depth of a projected point [m]
# Maximum depth of visible keypoints behind the surface of their own body [m]: slightly more than
# the greatest depth among the twelve people of the cast in views without self-occlusion.
NOSE, EYE, EAR, SHOULDER, ELBOW, WRIST = 0.04, 0.04, 0.05, 0.12, 0.08, 0.065
HIP, KNEE, ANKLE = 0.16, 0.11, 0.09
PAIRS = (EYE, EAR, SHOULDER, ELBOW, WRIST, HIP, KNEE, ANKLE)
INSIDE_M: F64 = np.array([NOSE, *np.repeat(PAIRS, 2)])
BEFORE_M = 0.02  # minimum distance of an occluder in front of a point [m]


@dataclass(frozen=True)
class PersonView:
    """Ground truth of one person in one frame."""

    id: str  # identity in motion capture
    position_m: F64  # 3, torso = mean of both shoulders and both hips, frame: map
    velocity_mps: F64  # 3, derivative of position_m
    yaw_rad: float  # yaw of the chest, frame: map
    path_yaw_rad: float  # yaw of the path, frame: map
    keypoints_m: F64  # 17x3, COCO order, frame: map
    keypoints_px: F64  # 17x2, projected; NaN behind the camera
    visible: U8  # 17, 1: in the image and not occluded
    box_xyxy_px: F64  # 4, box of the unoccluded body in the image; NaN if outside
    visible_share: float  # unoccluded part of the body's pixels in the image, 0 to 1


def person_views(
    world: World, t_s: float, view: DepthView, meshes: Sequence[Mesh] | None = None
) -> tuple[PersonView, ...]:
    """Return the truth about each person in a frame, in the order of the scenario.

    Args:
        world: Simulated world.
        t_s: Time of the frame.
        view: Depth and owners of the frame.
        meshes: Bodies at that time; None: computed.
    """
    meshes = world.meshes(t_s) if meshes is None else meshes
    pairs = zip(world.keypoints_m(t_s), meshes, strict=True)
    return tuple(
        _person_view(world, t_s, k, points, view, mesh) for k, (points, mesh) in enumerate(pairs)
    )


def _person_view(
    world: World, t_s: float, k: int, keypoints_m: F64, view: DepthView, mesh: Mesh
) -> PersonView:
    now, info = capture(world, k, t_s), world.info
    points_m = apply(world.optical_from_map(t_s), keypoints_m)
    pixels = project_visible(points_m, info)
    visible = in_image(pixels, info)
    inside = pixels[visible], points_m[visible, 2], INSIDE_M[visible]
    visible[visible] &= ~hidden(*inside, view, k + 1)
    extent = body_extents(mesh, world.optical_from_map(t_s), info)
    visible_pixels = int(np.count_nonzero(view.owners == k + 1))
    return PersonView(
        id=person_id(k),
        position_m=now.position_m,
        velocity_mps=velocity_mps(world, k, t_s),
        yaw_rad=now.yaw_rad,
        path_yaw_rad=now.path_yaw_rad,
        keypoints_m=keypoints_m,
        keypoints_px=pixels,
        visible=visible.astype(np.uint8),
        box_xyxy_px=extent.box_xyxy_px,
        visible_share=min(1.0, visible_pixels / extent.pixels) if extent.pixels else 0.0,
    )


def project_visible(points_m: F64, info: CameraInfo) -> F64:
    """Project Nx3 points of the optical frame to Nx2 pixels; NaN behind the camera."""
    before = points_m[:, 2] > NEAR_M
    pixels = np.full((len(points_m), 2), np.nan)
    pixels[before] = project(points_m[before], info)
    return pixels


def in_image(pixels: F64, info: CameraInfo) -> npt.NDArray[np.bool_]:
    """Return the mask of Nx2 positions in the image; the centres of its pixels are integers."""
    inside = (pixels > -0.5) & (pixels < (info.width - 0.5, info.height - 0.5))
    return np.asarray(inside.all(axis=1))


def hidden(
    pixels: F64, depth_m: F64, inside_m: F64, view: DepthView, owner: int
) -> npt.NDArray[np.bool_]:
    """Return the mask of occluded points of a body; its own limbs may occlude it.

    Args:
        pixels: Nx2, in the image.
        depth_m: Depths of the points, N.
        inside_m: Maximum depths of visible points behind the body's surface, N.
        view: Depth and owners of the image.
        owner: Number of the body.
    """
    column, row = np.rint(pixels).astype(int).T
    allowed_m = np.where(view.owners[row, column] == owner, inside_m, BEFORE_M)
    return np.asarray(view.depth_m[row, column] < depth_m - allowed_m)


def visible_points(world: World, points_m: F64, depth_m: F32, owners: U8, person: int) -> U8:
    """Return 1 for visible points of a person, else 0; points Mx3, optical frame."""
    pixels = project_visible(points_m, world.info)
    visible = in_image(pixels, world.info)
    column, row = np.rint(pixels[visible]).astype(int).T
    own = owners[row, column] == person + 1
    visible[visible] = own & (depth_m[row, column] > points_m[visible, 2] - BEFORE_M)
    return visible.astype(np.uint8)
