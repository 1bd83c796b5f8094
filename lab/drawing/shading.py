"""Radiance of each pixel, from its surface and the lights."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from common.compiled import compiled
from lab.drawing.ambient import smoothed
from lab.drawing.mesh import I32, Material
from lab.drawing.raster import barycentrics
from lab.drawing.shadows import BIAS_M, FOCAL_PX, lit_share
from lab.drawing.textures import body_texel, fold_slope, hashed, room_texel
from people4d.messages import F32, F64

# Compiled functions compare integers.
SKIN, SHIRT, TROUSERS = int(Material.SKIN), int(Material.SHIRT), int(Material.TROUSERS)
EYE, LAMP = int(Material.EYE), int(Material.LAMP)
SHIRT_FOLDS, TROUSER_FOLDS = 0.033, 0.032  # depth of the folds of cloth [m]
WRAP = 0.22  # extension of light beyond the edge of a shadow, by scattering in skin
TURNS: F64 = np.array([[math.cos(a), math.sin(a)] for a in np.arange(64) * (math.pi / 32)])
SOFT_PX = 12.0  # radius of a shadow's penumbra in the map, for a light of 1 m [px]
BRIGHTEST = 6.0  # maximum radiance of one sample: the edges of lamps are smooth


class SceneArrays(NamedTuple):
    """Triangles in the camera's view; the arrays of `Mesh`."""

    corners: F64  # Vx3, see `raster.homogeneous`, in samples
    vertices: F64
    normals: F64
    texture: F32
    colour: F32
    faces: I32
    material: I32
    pattern: I32
    eye: F64  # [m] 3, position of the camera, frame: map


class SceneLighting(NamedTuple):
    """Lights of the scene."""

    lights: F64  # Lx10: position 3, direction 3, intensity 3, radius
    projections: F64  # Lx3x4 into the lights' maps, see `shadows.pixels_from_map`
    maps: F32  # [1/m] LxSxS, see `shadows.shadow_map`
    bounce: F64  # see `ambient.bounce_light`
    room: F64  # [m] 2x3: middle and half size
    corners: F32  # coarse image, see `ambient.corner_light`


class SampleArrays(NamedTuple):
    """Samples of the rasteriser, several per pixel."""

    inverse: F32  # [1/m] see `raster.Raster`
    triangle: I32
    side: int  # number of samples per pixel in both directions
    focal: float  # [samples] focal length
    step: int  # samples per pixel of the coarse corner light, in both directions


@compiled
def shade_rows(
    scene: SceneArrays,
    light: SceneLighting,
    samples: SampleArrays,
    wanted: npt.NDArray[np.bool_],
    first: int,
    last: int,
    image: F32,
) -> None:
    """Write the radiance of the wanted pixels, HxW, in rows of the image, HxWx3.

    A pixel with one smooth surface is shaded once; at edges each sample is shaded.
    """
    side = samples.side
    for row in range(first, last):
        for column in range(image.shape[1]):
            if not wanted[row, column]:
                continue
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
def _one_surface(scene: SceneArrays, samples: SampleArrays, v: int, u: int) -> bool:
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
            n = scene.normals
            if n[p, 0] * n[q, 0] + n[p, 1] * n[q, 1] + n[p, 2] * n[q, 2] < 0.7:
                return False
            if abs(scene.colour[p, 1] - scene.colour[q, 1]) > 0.1:
                return False
    return True


@compiled
def _shade(
    scene: SceneArrays, light: SceneLighting, samples: SampleArrays, v: int, u: int
) -> tuple[float, float, float]:
    face = samples.triangle[v, u]
    if face < 0:
        return 0.0, 0.0, 0.0
    i, j, k = scene.faces[face, 0], scene.faces[face, 1], scene.faces[face, 2]
    wb, wc = barycentrics(scene.corners, i, j, k, float(u), float(v))
    corner, weights = (i, j, k), (1.0 - wb - wc, wb, wc)
    px, py, pz = _mixed(scene.vertices, corner, weights)
    nx, ny, nz = _mixed(scene.normals, corner, weights)
    tx, ty, tz = _mixed(scene.texture, corner, weights)
    colour = _mixed(scene.colour, corner, weights)
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
    surface = (gloss, sharpness, hashed(v, u, 3), 1.0 if material == SKIN else 0.0)
    dr, dg, db, shine = _from_lights(light, (px, py, pz), normal, (ex, ey, ez), surface)
    direct = 0.35 + 0.65 * open_share
    glow = gloss * shine * direct
    # Grazing light is reflected more: floors mirror walls faintly, cheeks have a bright rim.
    rim = gloss * 0.55 * (1.0 - min(1.0, abs(facing))) ** 4 * open_share
    return (
        r * (ar * open_share + dr * direct) + rim * ar + glow * 1.0,
        g * (ag * open_share + dg * direct) + rim * ag + glow * 0.97,
        b * (ab * open_share + db * direct) + rim * ab + glow * 0.92,
    )


@compiled
def _mixed(
    values: F64 | F32, corner: tuple[int, int, int], weights: tuple[float, float, float]
) -> tuple[float, float, float]:
    i, j, k = corner
    a, b, c = weights
    return (
        a * values[i, 0] + b * values[j, 0] + c * values[k, 0],
        a * values[i, 1] + b * values[j, 1] + c * values[k, 1],
        a * values[i, 2] + b * values[j, 2] + c * values[k, 2],
    )


@compiled
def _from_walls(
    light: SceneLighting, point: tuple[float, float, float], normal: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Return the irradiance from the walls, see `ambient.bounce_light`."""
    x = (point[0] - light.room[0, 0]) / light.room[1, 0]
    y = (point[1] - light.room[0, 1]) / light.room[1, 1]
    z = (point[2] - light.room[0, 2]) / light.room[1, 2]
    red, green, blue = 0.0, 0.0, 0.0
    for axis in range(3):
        c, n = light.bounce, 2 * axis + (1 if normal[axis] > 0 else 0)
        w = normal[axis] * normal[axis]
        a, b, d = w * x, w * y, w * z
        e, f, g = a * x, b * y, d * z
        red += w * c[n, 0, 0] + a * c[n, 0, 1] + b * c[n, 0, 2] + d * c[n, 0, 3]
        red += e * c[n, 0, 4] + f * c[n, 0, 5] + g * c[n, 0, 6]
        green += w * c[n, 1, 0] + a * c[n, 1, 1] + b * c[n, 1, 2] + d * c[n, 1, 3]
        green += e * c[n, 1, 4] + f * c[n, 1, 5] + g * c[n, 1, 6]
        blue += w * c[n, 2, 0] + a * c[n, 2, 1] + b * c[n, 2, 2] + d * c[n, 2, 3]
        blue += e * c[n, 2, 4] + f * c[n, 2, 5] + g * c[n, 2, 6]
    return red, green, blue


@compiled
def _from_lights(
    light: SceneLighting,
    point: tuple[float, float, float],
    normal: tuple[float, float, float],
    eye: tuple[float, float, float],
    surface: tuple[float, float, float, float],
) -> tuple[float, float, float, float]:
    """Return the irradiance from all lights, and their specular reflection.

    `surface`: gloss, sharpness of the gloss, a random number per pixel, and 1 for skin.
    """
    gloss, sharpness, random, skin = surface
    step = int(random * (len(TURNS) - 1))
    turn = (TURNS[step, 0], TURNS[step, 1])
    red, green, blue, shine = 0.0, 0.0, 0.0, 0.0
    for index in range(len(light.lights)):
        lamp, q = light.lights[index], light.projections[index]
        x, y, z = lamp[0] - point[0], lamp[1] - point[1], lamp[2] - point[2]
        squared = x * x + y * y + z * z
        distance = math.sqrt(squared)
        near = 1.0 / distance
        x, y, z = x * near, y * near, z * near
        falling = normal[0] * x + normal[1] * y + normal[2] * z
        emitted = -(x * lamp[3] + y * lamp[4] + z * lamp[5])
        wrapped = (falling + WRAP) / (1 + WRAP) if skin > 0 else falling
        if wrapped <= 0.0 or emitted <= 0.0:
            continue
        power = emitted / (squared + lamp[9] * lamp[9])
        # The point is moved off its surface to avoid self-shadowing.
        sx, sy = point[0] + 0.01 * normal[0], point[1] + 0.01 * normal[1]
        sz = point[2] + 0.01 * normal[2]
        depth = q[2, 0] * sx + q[2, 1] * sy + q[2, 2] * sz + q[2, 3]
        if depth > 0.05:
            scale = 1.0 / depth
            u = (q[0, 0] * sx + q[0, 1] * sy + q[0, 2] * sz + q[0, 3]) * scale
            v = (q[1, 0] * sx + q[1, 1] * sy + q[1, 2] * sz + q[1, 3]) * scale
            radius = SOFT_PX * lamp[9]
            # One side of a slanted surface is nearer to the light.
            slant = (1.0 - falling * falling) / max(falling, 0.12)
            bias = BIAS_M + 0.7 * depth * radius / FOCAL_PX * slant
            around = (radius * turn[0], radius * turn[1])
            power *= lit_share(light.maps, index, (u, v), 1.0 / (depth - bias), around)
        straight = max(falling, 0.0)
        red += power * wrapped * lamp[6]
        green += power * (wrapped if skin == 0 else 0.4 * wrapped + 0.6 * straight) * lamp[7]
        blue += power * (wrapped if skin == 0 else straight) * lamp[8]
        if falling > 0.0 and gloss > 0.0:
            hx, hy, hz = x + eye[0], y + eye[1], z + eye[2]
            length = math.sqrt(hx * hx + hy * hy + hz * hz) + 1e-9
            peak = (normal[0] * hx + normal[1] * hy + normal[2] * hz) / length
            if peak > 0.7:
                # Approximation of peak ** sharpness [Schlick 1993]
                peak /= sharpness - (sharpness - 1.0) * peak
                shine += power * lamp[7] * peak * (sharpness + 8.0) / 12.0
    return red, green, blue, shine
