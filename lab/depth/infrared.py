"""Infrared light that surfaces return to a depth sensor with a projector.

Reflectances are chosen by eye, on recordings of two Xtions: black cloth returns infrared light,
since dyes absorb little of it; hair, screens and glossy surfaces return little; windows and lamps
outshine the projector.
"""

import numpy as np

from common.geometry.transforms import apply
from lab.drawing.mesh import I32, Material, Mesh
from people4d.messages import F32, F64

# Infrared reflectance of black surfaces, and its growth with the visible reflectance
REFLECTANCE = {
    Material.SKIN: (0.5, 0.2),
    Material.HAIR: (0.03, 0.6),
    Material.SHIRT: (0.18, 0.6),
    Material.TROUSERS: (0.15, 0.6),
    Material.SHOE: (0.05, 0.5),
    Material.METAL: (0.02, 0.5),
    Material.FABRIC: (0.02, 0.8),
    Material.LAMP: (0.0, 0.0),
    Material.MIRROR: (0.4, 0.0),  # mean of mirrored surfaces
}
OTHER = (0.05, 0.7)


def reflectance(mesh: Mesh) -> F64:
    """Return the infrared reflectance of F faces, 0 to 1."""
    grey = mesh.colour[mesh.faces].mean(axis=(1, 2), dtype=np.float64)
    table = np.array([REFLECTANCE.get(material, OTHER) for material in Material])
    numbers = np.array([int(material) for material in Material])
    rows = table[np.searchsorted(numbers, mesh.material)]
    return np.asarray(np.clip(rows[:, 0] + rows[:, 1] * grey, 0.0, 1.0))


def returned(mesh: Mesh, triangle: I32, optical_from_map: F64, rays: F64, depth_m: F32) -> F32:
    """Return the light returned to each pixel [1/m^2]: reflectance x cosine / distance^2.

    Args:
        mesh: Mesh of the scene.
        triangle: HxW face at each pixel, -1: none.
        optical_from_map: Transform into the depth imager, 4x4.
        rays: HxWx3 directions of the pixels, z = 1.
        depth_m: HxW.
    """
    points = apply(optical_from_map, mesh.vertices_m)[mesh.faces]
    normals = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
    weighted = np.append(normals * reflectance(mesh)[:, None], np.zeros((1, 3)), axis=0)
    squared = np.einsum("vui,vui->vu", rays, rays)
    # The cosine is n . r / |r|, the squared distance z^2 |r|^2.
    light = np.abs(np.einsum("vui,vui->vu", weighted[triangle], rays)) / squared**1.5
    with np.errstate(invalid="ignore"):
        return np.where(triangle >= 0, light / depth_m**2, 0.0).astype(np.float32)
