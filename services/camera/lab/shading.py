"""The colour of each pixel: what is seen there, and how much light it sends to the camera."""

import math
from typing import NamedTuple

import numpy as np

from common.messages import F32, F64
from services.camera.lab.ambient import smoothed
from services.camera.lab.compiled import compiled
from services.camera.lab.materials import Material
from services.camera.lab.mesh import I32
from services.camera.lab.raster import barycentrics
from services.camera.lab.shadows import lit_share
from services.camera.lab.textures import body_texel, fold_slope, hashed, room_texel

SKIN, HAIR, SHIRT = int(Material.SKIN), int(Material.HAIR), int(Material.SHIRT)
TROUSERS, EYE, LAMP = int(Material.TROUSERS), int(Material.EYE), int(Material.LAMP)
SHIRT_FOLDS, TROUSER_FOLDS = 0.050, 0.040  # [m] depth of the folds, about
WRAP = 0.22  # light that passes under the skin reaches beyond the shadow's edge
TURNS: F64 = np.array([[math.cos(a), math.sin(a)] for a in np.arange(64) * (math.pi / 32)])
BRIGHTEST = 6.0  # radiance of one sample, so that a lamp's edge is smooth


class Scene(NamedTuple):
    """The triangles as the camera sees them; see `Mesh`.

    Fields: corners Vx3 (see `raster.homogeneous`), the mesh's arrays, and the camera's place (3).
    """

    corners: F64
    vertices: F64
    normals: F64
    texture: F32
    colour: F32
    faces: I32
    material: I32
    pattern: I32
    eye: F64


class Lighting(NamedTuple):
    """What lights the scene.

    Fields: Lx10 lights (place, direction, intensity, radius), Lx3x4 projections into their maps,
    LxSxS maps, 6x3xTERMS light from the walls, 2x3 middle and half size of the room, and HxW
    coarse corner light.
    """

    lights: F64
    projections: F64
    maps: F32
    bounce: F64
    room: F64
    corners: F32


class Samples(NamedTuple):
    """What the rasteriser saw; `side` samples per pixel both ways.

    Fields: inverse depth and triangle per sample, side, focal length in samples, samples per
    pixel of the coarse corner light.
    """

    inverse: F32
    triangle: I32
    side: int
    focal: float
    step: int


@compiled
def shade_rows(
    scene: Scene, light: Lighting, samples: Samples, first: int, last: int, image: F32
) -> None:
    """Write the radiance of rows of the image, HxWx3.

    A pixel whose samples all see one smooth surface is shaded once; at edges each sample is.
    """
    side = samples.side
    for row in range(first, last):
        for column in range(image.shape[1]):
            v, u = row * side, column * side
            smooth = side == 1 or _one_surface(scene, samples, v, u)
            count = 1 if smooth else side * side
            red, green, blue = 0.0, 0.0, 0.0
            for index in range(count):
                r, g, b = _shade(scene, light, samples, v + index // side, u + index % side)
                red += min(r, BRIGHTEST)
                green += min(g, BRIGHTEST)
                blue += min(b, BRIGHTEST)
            image[row, column, 0] = red / count
            image[row, column, 1] = green / count
            image[row, column, 2] = blue / count


@compiled
def _one_surface(scene: Scene, samples: Samples, v: int, u: int) -> bool:
    """Return whether the samples of a pixel see neighbouring places on one smooth surface."""
    first = samples.triangle[v, u]
    for i in range(samples.side):
        for j in range(samples.side):
            other = samples.triangle[v + i, u + j]
            if other == first:
                continue
            if first < 0 or other < 0 or scene.material[other] != scene.material[first]:
                return False
            near, far = samples.inverse[v, u], samples.inverse[v + i, u + j]
            if abs(near - far) > 0.015 * near:
                return False
            p, q = scene.faces[first, 0], scene.faces[other, 0]
            n, m = scene.normals[p], scene.normals[q]
            if n[0] * m[0] + n[1] * m[1] + n[2] * m[2] < 0.7:
                return False
            if abs(scene.colour[p, 1] - scene.colour[q, 1]) > 0.1:
                return False
    return True


@compiled
def _shade(
    scene: Scene, light: Lighting, samples: Samples, v: int, u: int
) -> tuple[float, float, float]:
    """Return the radiance that one sample sees."""
    face = samples.triangle[v, u]
    if face < 0:
        return 0.0, 0.0, 0.0
    corner = scene.faces[face]
    wb, wc = barycentrics(scene.corners, corner, float(u), float(v))
    wa = 1.0 - wb - wc
    px, py, pz = _mixed(scene.vertices, corner, wa, wb, wc)
    nx, ny, nz = _mixed(scene.normals, corner, wa, wb, wc)
    tx, ty, tz = _mixed(scene.texture, corner, wa, wb, wc)
    colour = _mixed(scene.colour, corner, wa, wb, wc)
    material = scene.material[face]
    if material == LAMP:
        return colour
    ex, ey, ez = scene.eye[0] - px, scene.eye[1] - py, scene.eye[2] - pz
    distance = math.sqrt(ex * ex + ey * ey + ez * ez)
    ex, ey, ez = ex / distance, ey / distance, ez / distance
    facing = nx * ex + ny * ey + nz * ez
    if facing < 0.0:
        nx, ny, nz = -nx, -ny, -nz
    if material <= EYE:
        r, g, b, gloss, sharpness = body_texel(material, scene.pattern[face], tx, ty, tz, colour)
    else:
        blur_m = distance / samples.focal * samples.side / max(abs(facing), 0.1)
        r, g, b, gloss, sharpness = room_texel(material, tx, ty, tz, colour, blur_m)
    if material in (SHIRT, TROUSERS):
        depth = SHIRT_FOLDS if material == SHIRT else TROUSER_FOLDS
        sx, sy, sz = fold_slope(tx, ty, tz)
        nx, ny, nz = nx - depth * sx, ny - depth * sy, nz - depth * sz
    length = math.sqrt(nx * nx + ny * ny + nz * nz) + 1e-12
    normal = (nx / length, ny / length, nz / length)
    open_share = smoothed(light.corners, samples.inverse, samples.step, v, u)
    ar, ag, ab = _from_walls(light, (px, py, pz), normal)
    dr, dg, db, shine = _from_lights(
        light,
        (px, py, pz),
        normal,
        (ex, ey, ez),
        (sharpness, hashed(v, u, 3), 1.0 if material == SKIN else 0.0),
    )
    direct = 0.35 + 0.65 * open_share
    glow = gloss * shine * direct
    # Grazing light is thrown back more: walls show faintly in floors, cheeks have a bright rim.
    rim = gloss * 0.55 * (1.0 - min(1.0, abs(facing))) ** 4 * open_share
    return (
        r * (ar * open_share + dr * direct) + rim * ar + glow * 1.0,
        g * (ag * open_share + dg * direct) + rim * ag + glow * 0.97,
        b * (ab * open_share + db * direct) + rim * ab + glow * 0.92,
    )


@compiled
def _mixed(
    values: F64 | F32, corner: I32, wa: float, wb: float, wc: float
) -> tuple[float, float, float]:
    """Return the mean of the rows of three corners with weights."""
    i, j, k = corner[0], corner[1], corner[2]
    return (
        wa * values[i, 0] + wb * values[j, 0] + wc * values[k, 0],
        wa * values[i, 1] + wb * values[j, 1] + wc * values[k, 1],
        wa * values[i, 2] + wb * values[j, 2] + wc * values[k, 2],
    )


@compiled
def _from_walls(
    light: Lighting, place: tuple[float, float, float], normal: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Return the irradiance that comes from the walls, see `ambient.bounce_light`."""
    x = (place[0] - light.room[0, 0]) / light.room[1, 0]
    y = (place[1] - light.room[0, 1]) / light.room[1, 1]
    z = (place[2] - light.room[0, 2]) / light.room[1, 2]
    red, green, blue = 0.0, 0.0, 0.0
    for axis in range(3):
        c = light.bounce[2 * axis + (1 if normal[axis] > 0 else 0)]
        w = normal[axis] * normal[axis]
        a, b, d = w * x, w * y, w * z
        e, f, g = a * x, b * y, d * z
        red += w * c[0, 0] + a * c[0, 1] + b * c[0, 2] + d * c[0, 3]
        red += e * c[0, 4] + f * c[0, 5] + g * c[0, 6]
        green += w * c[1, 0] + a * c[1, 1] + b * c[1, 2] + d * c[1, 3]
        green += e * c[1, 4] + f * c[1, 5] + g * c[1, 6]
        blue += w * c[2, 0] + a * c[2, 1] + b * c[2, 2] + d * c[2, 3]
        blue += e * c[2, 4] + f * c[2, 5] + g * c[2, 6]
    return red, green, blue


@compiled
def _from_lights(
    light: Lighting,
    place: tuple[float, float, float],
    normal: tuple[float, float, float],
    eye: tuple[float, float, float],
    surface: tuple[float, float, float],
) -> tuple[float, float, float, float]:
    """Return the irradiance from all lights and the light they mirror into the eye.

    `surface` is the sharpness of its gloss, a random number per pixel, and 1 for skin.
    """
    sharpness, random, skin = surface
    turn = TURNS[int(random * (len(TURNS) - 1))]
    red, green, blue, shine = 0.0, 0.0, 0.0, 0.0
    for index in range(len(light.lights)):
        lamp = light.lights[index]
        x, y, z = lamp[0] - place[0], lamp[1] - place[1], lamp[2] - place[2]
        squared = x * x + y * y + z * z
        distance = math.sqrt(squared)
        x, y, z = x / distance, y / distance, z / distance
        falling = normal[0] * x + normal[1] * y + normal[2] * z
        emitted = -(x * lamp[3] + y * lamp[4] + z * lamp[5])
        wrapped = (falling + WRAP) / (1 + WRAP) if skin > 0 else falling
        if wrapped <= 0.0 or emitted <= 0.0:
            continue
        power = emitted / (squared + lamp[9] * lamp[9])
        q = light.projections[index]
        # The point is moved off its surface, so that it does not shadow itself.
        sx, sy, sz = (
            place[0] + 0.01 * normal[0],
            place[1] + 0.01 * normal[1],
            place[2] + 0.01 * normal[2],
        )
        depth = q[2, 0] * sx + q[2, 1] * sy + q[2, 2] * sz + q[2, 3]
        if depth > 0.05:
            u = (q[0, 0] * sx + q[0, 1] * sy + q[0, 2] * sz + q[0, 3]) / depth
            v = (q[1, 0] * sx + q[1, 1] * sy + q[1, 2] * sz + q[1, 3]) / depth
            radius = 12.0 * lamp[9]
            power *= lit_share(light.maps[index], u, v, depth, radius * turn[0], radius * turn[1])
        red += power * wrapped * lamp[6]
        green += (
            power * (wrapped if skin == 0 else 0.4 * wrapped + 0.6 * max(falling, 0.0)) * lamp[7]
        )
        blue += power * (wrapped if skin == 0 else max(falling, 0.0)) * lamp[8]
        if falling > 0.0:
            hx, hy, hz = x + eye[0], y + eye[1], z + eye[2]
            length = math.sqrt(hx * hx + hy * hy + hz * hz) + 1e-9
            peak = (normal[0] * hx + normal[1] * hy + normal[2] * hz) / length
            if peak > 0.7:
                # Schlick's stand-in for peak ** sharpness (A customizable reflectance model, 1993).
                peak /= sharpness - (sharpness - 1.0) * peak
                shine += power * lamp[7] * peak * (sharpness + 8.0) / 12.0
    return red, green, blue, shine
