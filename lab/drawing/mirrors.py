"""Mirrors: the image of a scene is the scene itself, seen by a camera that is reflected too.

A depth camera measures the distance of the virtual image, behind the mirror.
"""

from collections.abc import Iterator

import numpy as np

from common.geometry.transforms import camera_matrix
from lab.drawing.mesh import Material, Mesh
from lab.drawing.raster import Raster, homogeneous, rasterise
from people4d.messages import F32, F64, CameraInfo

REFLECTANCE = 0.88  # reflected share of the light
CLOSER = np.float32(1 - 1e-4)  # inverse depth of the nearest surface in a mirror, of the mirror's
FACES = 2  # number of triangles of a mirror


def mirror_views(scene: Mesh, raster: Raster) -> Iterator[tuple[F64, F32]]:
    """Yield, for each visible mirror, its reflection and the part of the image that it covers.

    Args:
        scene: Mesh with the mirrors.
        raster: Raster of the scene.

    Yields:
        Reflection of the map, 4x4; maximum inverse depth of surfaces in the mirror, HxW, 0 outside.
    """
    for faces in np.flatnonzero(scene.material == Material.MIRROR).reshape(-1, FACES):
        inside = np.isin(raster.triangle, faces)
        if inside.any():
            corner = scene.faces[faces[0], 0]
            yield (
                reflection(scene.vertices_m[corner], scene.normals[corner]),
                np.where(inside, raster.inverse_depth * CLOSER, np.float32(0)),
            )


def reflection(point_m: F64, normal: F64) -> F64:
    """Return the reflection at a plane, given a point and its unit normal, 4x4."""
    matrix = np.eye(4)
    matrix[:3, :3] -= 2 * np.outer(normal, normal)
    matrix[:3, 3] = 2 * (normal @ point_m) * normal
    return matrix


def rasterise_image(
    scene: Mesh, optical_from_map: F64, info: CameraInfo, shift_px: float, threads: int
) -> Raster:
    """Return the raster of a scene, in which mirrors have the depth of their images.

    Args:
        scene: Mesh of the scene.
        optical_from_map: Transform into the camera, 4x4.
        info: Calibration.
        shift_px: Shift of the imager to the right, focal length x baseline [px m].
        threads: Number of threads.
    """

    def draw(pose: F64, limit: F32 | None = None) -> Raster:
        corners = homogeneous(scene.vertices_m, camera_matrix(info) @ pose[:3])
        corners -= (shift_px, 0.0, 0.0)
        return rasterise(corners, scene.faces, (info.height, info.width), threads, limit)

    raster = draw(optical_from_map)
    for matrix, limit in mirror_views(scene, raster):
        image = draw(optical_from_map @ matrix, limit)
        raster.inverse_depth[limit > 0] = image.inverse_depth[limit > 0]
    return raster
