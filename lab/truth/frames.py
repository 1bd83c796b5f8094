"""Truth about the people in one frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common.geometry.transforms import apply, project
from lab.drawing.mesh import Mesh
from lab.drawing.renderer import DepthView, body_extents
from lab.truth.motion_capture import capture, person_id, velocity_mps
from lab.truth.silhouette import Silhouette, silhouettes
from lab.world import World
from people4d.messages import F32, F64, U8, CameraInfo

NEAR_M = 0.1  # points nearer to the camera's plane have no pixel
# [m] how deep keypoints (COCO order) may lie behind the skin or cloth in front of them: a little
# more than the greatest depths of twelve people seen from the sides where their own body does not
# hide the point, less than where it does.
NOSE, EYE, EAR, SHOULDER, ELBOW, WRIST = 0.04, 0.04, 0.05, 0.12, 0.08, 0.065
HIP, KNEE, ANKLE = 0.16, 0.11, 0.09
PAIRS = (EYE, EAR, SHOULDER, ELBOW, WRIST, HIP, KNEE, ANKLE)
INSIDE_M: F64 = np.array([NOSE, *np.repeat(PAIRS, 2)])
BEFORE_M = 0.02  # other things hide a point when they are nearer by more than this


@dataclass(frozen=True)
class PersonView:
    """Truth about one person in one frame."""

    id: str  # identity in motion capture
    position_m: F64  # 3, torso = mean of both shoulders and both hips, frame: map
    velocity_mps: F64  # 3, derivative of position_m
    yaw_rad: float  # of the chest, frame: map
    path_yaw_rad: float  # of the path, frame: map
    keypoints_m: F64  # 17x3, COCO order, frame: map
    keypoints_px: F64  # 17x2, projected; NaN behind the camera
    visible: U8  # 17, True: in the image and not hidden by anything
    box_xyxy_px: F64  # 4, of the whole body as if nothing hid it, cut to the image; NaN if outside
    visible_share: float  # part of the body's pixels in the image that nothing hides, 0 to 1


@dataclass(frozen=True)
class _Visibility:
    """Visible part of a person; fields as in `PersonView`."""

    visible: npt.NDArray[np.bool_]
    box_xyxy_px: F64
    share: float


def person_views(
    world: World, t_s: float, view: DepthView | None, meshes: Sequence[Mesh] | None = None
) -> tuple[PersonView, ...]:
    """Return the truth about each person in a frame, in the order of the scenario.

    Args:
        world: Simulated world.
        t_s: Time of the frame.
        view: Depth and owners then. None: without drawing; only people hide people, and bodies are
            capsules about their keypoints, see `silhouette`.
        meshes: The bodies at that time, if they are at hand.
    """
    optical_from_map = world.optical_from_map(t_s)
    keypoints = world.keypoints_m(t_s)
    if view is None:
        found = silhouettes(keypoints, optical_from_map, world.info)
        visibility = [_outlined(found.get(k), world.info) for k in range(len(keypoints))]
    else:
        meshes = world.meshes(t_s) if meshes is None else meshes
        pairs = zip(keypoints, meshes, strict=True)
        visibility = [
            _drawn(points, mesh, view, optical_from_map, world.info) for points, mesh in pairs
        ]
    return tuple(
        _person_view(world, t_s, k, points, visibility[k]) for k, points in enumerate(keypoints)
    )


def _person_view(
    world: World, t_s: float, k: int, keypoints_m: F64, visibility: _Visibility
) -> PersonView:
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
        visible=visibility.visible.astype(np.uint8),
        box_xyxy_px=visibility.box_xyxy_px,
        visible_share=visibility.share,
    )


def _drawn(
    keypoints_m: F64, mesh: Mesh, view: DepthView, optical_from_map: F64, info: CameraInfo
) -> _Visibility:
    points_m = apply(optical_from_map, keypoints_m)
    pixels = project_visible(points_m, info)
    visible = in_image(pixels, info)
    owner = int(mesh.owner[0])
    visible[visible] &= ~hidden(
        pixels[visible], points_m[visible, 2], view, owner, INSIDE_M[visible]
    )
    extent = body_extents(mesh, optical_from_map, info)
    visible_pixels = int(np.count_nonzero(view.owners == owner))
    share = min(1.0, visible_pixels / extent.pixels) if extent.pixels else 0.0
    return _Visibility(visible, extent.box_xyxy_px, share)


def _outlined(outline: Silhouette | None, info: CameraInfo) -> _Visibility:
    box = np.full(4, np.nan)
    if outline is None:
        return _Visibility(np.zeros(17, np.bool_), box, 0.0)
    cut = outline.box_xyxy_px.clip(0, [info.width, info.height] * 2)
    if np.all(cut[:2] < cut[2:]):
        box = cut
    return _Visibility(outline.visible, box, outline.visible_share)


def project_visible(points_m: F64, info: CameraInfo) -> F64:
    """Return Nx2 pixels of Nx3 points of the optical frame; NaN behind the camera."""
    before = points_m[:, 2] > NEAR_M
    pixels = np.full((len(points_m), 2), np.nan)
    pixels[before] = project(points_m[before], info)
    return pixels


def in_image(pixels: F64, info: CameraInfo) -> npt.NDArray[np.bool_]:
    """Return the mask of Nx2 pixels in the image, whose pixels have whole numbers as centres."""
    inside = (pixels > -0.5) & (pixels < (info.width - 0.5, info.height - 0.5))
    return np.asarray(inside.all(axis=1))


def hidden(
    pixels: F64, depth_m: F64, view: DepthView, owner: int, inside_m: F64
) -> npt.NDArray[np.bool_]:
    """Return the mask of points of a body that something hides, its own limbs included.

    Args:
        pixels: Nx2, in the image.
        depth_m: N, of the points.
        view: Depth and owners of the image.
        owner: Number of the body.
        inside_m: N, how deep each point may lie behind the body's surface.
    """
    column, row = np.rint(pixels).astype(int).T
    allowed_m = np.where(view.owners[row, column] == owner, inside_m, BEFORE_M)
    return np.asarray(view.depth_m[row, column] < depth_m - allowed_m)


def visible_points(world: World, points_m: F64, depth_m: F32, owners: U8, person: int) -> U8:
    """Return 1 for points (Mx3, optical frame) of a person that the camera sees, else 0."""
    pixels = project_visible(points_m, world.info)
    visible = in_image(pixels, world.info)
    column, row = np.rint(pixels[visible]).astype(int).T
    own = owners[row, column] == person + 1
    visible[visible] = own & (depth_m[row, column] > points_m[visible, 2] - BEFORE_M)
    return visible.astype(np.uint8)
