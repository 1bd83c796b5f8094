"""Shadow maps: distances from each light, and the share of a light visible from a point."""

import math
from dataclasses import replace

import numpy as np

from common.compiled import compiled
from lab.drawing.mesh import Material, Mesh
from lab.drawing.raster import homogeneous, rasterise
from lab.drawing.rooms import Light, Room
from people4d.messages import F32, F64

SIDE_PX = 768  # side of a map [px]
HALF_VIEW_RAD = math.radians(66)  # half the field of view of a map [rad]
FOCAL_PX = SIDE_PX / 2 / math.tan(HALF_VIEW_RAD)
BIAS_M = 0.025  # minimum distance of an occluder, against self-shadowing [m]
TAPS = 12  # number of readings of the map at the penumbra of a shadow
CASTS_NONE = (Material.PAINT, Material.LAMP)  # materials without shadows

# Offsets of the readings, on a spiral that fills the unit disc evenly
_TURN = np.arange(TAPS) * (math.pi * (3 - math.sqrt(5)))
SPIRAL: F64 = np.sqrt((np.arange(TAPS) + 0.5) / TAPS)[:, None] * np.column_stack(
    [np.cos(_TURN), np.sin(_TURN)]
)


def pixels_from_map(light: Light) -> F64:
    """Return the 3x4 projection into the map of a light, along its axis."""
    forward = light.towards
    right = np.cross(forward, [0.0, 0.0, 1.0] if abs(forward[2]) < 0.9 else [1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    rotation = np.array([right, np.cross(forward, right), forward])
    centre_px = (SIDE_PX - 1) / 2
    camera = np.array([[FOCAL_PX, 0, centre_px], [0, FOCAL_PX, centre_px], [0, 0, 1.0]])
    return np.asarray(camera @ np.column_stack([rotation, -rotation @ light.position_m]))


def shadow_map(mesh: Mesh, projection: F64) -> F32:
    """Return the inverse distance to the nearest surface along a light's axis [1/m]; 0: none."""
    corners = homogeneous(mesh.vertices_m, projection)
    return rasterise(corners, mesh.faces, (SIDE_PX, SIDE_PX)).inverse_depth


def room_shadow_maps(room: Room) -> F32:
    """Return LxSxS maps of the room without people."""
    casting = ~np.isin(room.mesh.material, CASTS_NONE)
    solid = replace(room.mesh, faces=np.ascontiguousarray(room.mesh.faces[casting]))
    return np.stack([shadow_map(solid, pixels_from_map(light)) for light in room.lights])


@compiled
def lit_share(
    maps: F32, light: int, pixel: tuple[float, float], limit: float, turn: tuple[float, float]
) -> float:
    """Return the share of a light visible from a point, 0 to 1.

    Args:
        maps: LxSxS maps.
        light: Index of the light.
        pixel: Column and row of the point in the map.
        limit: Inverse distance along the light's axis beyond which surfaces hide the light [1/m].
        turn: Cosine and sine of the rotation of the readings, times the radius of the penumbra
            [px]; rotations of neighbours differ, so their errors are independent.
    """
    size = maps.shape[1]
    ca, sa = turn
    hidden, count = 0, 0
    for i in range(TAPS):
        x, y = SPIRAL[i, 0], SPIRAL[i, 1]
        column = int(pixel[0] + ca * x - sa * y + 0.5)
        row = int(pixel[1] + sa * x + ca * y + 0.5)
        if 0 <= column < size and 0 <= row < size:
            count += 1
            if maps[light, row, column] > limit:
                hidden += 1
        # Equal first readings, spread over the disc: the point is outside the penumbra.
        if i == 4 and (hidden == 0 or hidden == 5):
            break
    return 1.0 - hidden / count if count else 1.0
