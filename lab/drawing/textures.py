"""Solid textures: the colour of a material at a point inside it.

A body's texture is evaluated at positions in the rest pose, so patterns move with the body. Noise
is value noise on a lattice of hashed integers.
"""

import math

from common.compiled import compiled
from lab.drawing.mesh import Material, Pattern

# Compiled functions compare integers.
SKIN, HAIR, SHIRT = int(Material.SKIN), int(Material.HAIR), int(Material.SHIRT)
TROUSERS, SHOE, METAL = int(Material.TROUSERS), int(Material.SHOE), int(Material.METAL)
PLANKS, PAINT, WOOD = int(Material.PLANKS), int(Material.PAINT), int(Material.WOOD)
POSTER, BOOKS, FABRIC = int(Material.POSTER), int(Material.BOOKS), int(Material.FABRIC)
CARPET, CONCRETE = int(Material.CARPET), int(Material.CONCRETE)
STRIPES, PLAID, PRINT = int(Pattern.STRIPES), int(Pattern.PLAID), int(Pattern.PRINT)
PLACKET, BLOCKS = int(Pattern.PLACKET), int(Pattern.BLOCKS)

PLANK_M = (1.2, 0.13)  # length and width of a board [m]
MASK = 0xFFFFFFFF

Texel = tuple[float, float, float, float, float]


@compiled
def hashed(i: int, j: int, k: int) -> float:
    """Return a pseudo-random number from 0 to 1."""
    n = (i * 374761393 + j * 668265263 + k * 2147483647) & MASK
    n = ((n ^ (n >> 13)) * 1274126177) & MASK
    return ((n ^ (n >> 16)) & 0xFFFF) / 65535.0


@compiled
def noise(x: float, y: float, z: float) -> float:
    """Return smooth noise from 0 to 1 with features of size 1."""
    return noise_slope(x, y, z)[0]


@compiled
def noise_slope(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return smooth noise and its derivatives along x, y and z."""
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    fx, fy, fz = x - i, y - j, z - k
    ux, uy, uz = fx * fx * (3 - 2 * fx), fy * fy * (3 - 2 * fy), fz * fz * (3 - 2 * fz)
    a, b = hashed(i, j, k), hashed(i + 1, j, k)
    c, d = hashed(i, j + 1, k), hashed(i + 1, j + 1, k)
    e, f = hashed(i, j, k + 1), hashed(i + 1, j, k + 1)
    g, h = hashed(i, j + 1, k + 1), hashed(i + 1, j + 1, k + 1)
    ab, cd, ef, gh = a + (b - a) * ux, c + (d - c) * ux, e + (f - e) * ux, g + (h - g) * ux
    low, high = ab + (cd - ab) * uy, ef + (gh - ef) * uy
    dx_low, dx_high = (b - a) * (1 - uy) + (d - c) * uy, (f - e) * (1 - uy) + (h - g) * uy
    dx = (dx_low + (dx_high - dx_low) * uz) * 6 * fx * (1 - fx)
    dy = ((cd - ab) * (1 - uz) + (gh - ef) * uz) * 6 * fy * (1 - fy)
    dz = (high - low) * 6 * fz * (1 - fz)
    return low + (high - low) * uz, dx, dy, dz


@compiled
def fold_slope(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the slope of the folds of cloth: long vertical folds and small horizontal creases."""
    bend = 1.7 * noise(x * 4, y * 4, z * 4)
    _, ax, ay, az = noise_slope(x * 9 + bend, y * 9 + bend, z * 3.4 + bend)
    _, bx, by, bz = noise_slope(x * 17 - bend, y * 17, z * 25 + 2 * bend)
    return 6.7 * ax + 3.0 * bx, 6.7 * ay + 3.0 * by, 2.6 * az + 4.4 * bz


@compiled
def body_texel(
    material: int, pattern: int, x: float, y: float, z: float, colour: tuple[float, float, float]
) -> Texel:
    """Return the colour of skin, hair or cloth, its gloss (0 to 1) and the sharpness of the gloss.

    x, y and z: forward, left and up from the sole [m] in the rest pose; the colour is linear.
    """
    r, g, b = colour
    if material == SKIN:
        blood = noise(x * 38, y * 38, z * 38) - 0.5
        k = 0.96 + 0.10 * noise(x * 140, y * 140, z * 140)
        return r * k * (1 + 0.08 * blood), g * k * (1 - 0.05 * blood), b * k, 0.045, 14.0
    if material == HAIR:
        strand = noise(x * 170, y * 170, z * 18)
        k = 0.55 + 0.6 * strand + 0.3 * noise(x * 30, y * 30, z * 9)
        return r * k, g * k, b * k, 0.06 * strand, 22.0
    if material == SHIRT:
        r, g, b = _patterned(pattern, x, y, z, (r, g, b))
        k = 0.93 + 0.12 * noise(x * 260, y * 260, z * 260)
        return r * k, g * k, b * k, 0.0, 6.0
    if material == TROUSERS:
        worn = noise(x * 9, y * 9, z * 4)
        k = 0.84 + 0.2 * worn + 0.14 * (noise(x * 330, y * 330, z * 330) - 0.5)
        return r * k, g * k, b * k, 0.0, 6.0
    if material == SHOE:
        k = 0.85 + 0.25 * noise(x * 70, y * 70, z * 70)
        return r * k, g * k, b * k, 0.09, 25.0
    return r, g, b, 0.2, 90.0


@compiled
def _patterned(
    pattern: int, x: float, y: float, z: float, colour: tuple[float, float, float]
) -> tuple[float, float, float]:
    r, g, b = colour
    grey = 0.33 * (r + g + b)
    light = 0.62 if grey < 0.3 else 0.08
    if pattern == STRIPES and (z * 15.0) % 1.0 < 0.4:
        return light, light * 0.98, light * 0.93
    if pattern == PLAID:
        across, up = (y * 15.0 + x * 9.0) % 1.0, (z * 15.0) % 1.0
        k = (1.0 if across > 0.45 else 0.5) * (1.0 if up > 0.45 else 0.55)
        if across < 0.06 or up < 0.06:
            return 0.5, 0.46, 0.34
        return r * k, g * k, b * k
    if pattern == PRINT and x > 0.0:
        inside = (y / 0.105) ** 2 + ((z - 1.22) / 0.08) ** 2
        if inside < 1.0 and noise(y * 42, z * 42, 3.0) > 0.42:
            return light, light * 0.95, light * 0.85
    if pattern == PLACKET:
        k = 0.93 if (y * 55.0) % 1.0 < 0.2 else 1.0
        if x > 0.0 and abs(y) < 0.018:
            k = 0.45 if abs(y) < 0.005 and (z * 11.0) % 1.0 < 0.12 else 0.88
        return r * k, g * k, b * k
    if pattern == BLOCKS and z > 1.22:
        return 0.35 * r + 0.65 * light, 0.35 * g + 0.65 * light, 0.35 * b + 0.65 * light
    return r, g, b


@compiled
def room_texel(
    material: int, x: float, y: float, z: float, colour: tuple[float, float, float], blur_m: float
) -> Texel:
    """Return the colour of floors, walls and furniture, gloss and sharpness; see `body_texel`.

    x, y and z: position in the texture [m]; blur_m: size of a pixel on the surface.
    """
    r, g, b = colour
    k, gloss, sharpness = 1.0, 0.0, 10.0
    if material == PAINT:
        k = 0.95 + 0.06 * noise(x * 1.7, y * 1.7, z * 1.7)
        if blur_m < 0.012:  # roughness is visible at small distances only
            k += 0.04 * (noise(x * 90, y * 90, z * 90) - 0.5) * (1.0 - blur_m / 0.012)
    elif material == PLANKS:
        k, gloss, sharpness = _planks(x, y, blur_m), 0.10, 26.0
        warm = 0.04 * (hashed(math.floor(y / PLANK_M[1]), 5, 9) - 0.5)
        r, b = r * (1 + warm), b * (1 - 2 * warm)
    elif material == WOOD:
        rings = noise(x * 1.8, y * 34, z * 34)
        k = 0.82 + 0.22 * rings + 0.14 * noise(x * 5, y * 150, z * 150)
        gloss, sharpness = 0.06, 20.0
    elif material == CARPET:
        k = 0.72 + 0.3 * noise(x * 260, y * 260, z * 260) + 0.22 * noise(x * 60, y * 60, z * 60)
        k *= 0.92 + 0.12 * noise(x * 1.3, y * 1.3, 0.0)
        tile = 0.9 if (math.floor(x * 2) + math.floor(y * 2)) % 2 == 0 else 1.0
        k *= tile
    elif material == CONCRETE:
        k = 0.8 + 0.2 * noise(x * 1.1, y * 1.1, z) + 0.12 * noise(x * 7, y * 7, z * 7)
        k += 0.06 * noise(x * 70, y * 70, z * 70)
        joint = min((x * 0.5) % 1.0, 1 - (x * 0.5) % 1.0, (y * 0.5) % 1.0, 1 - (y * 0.5) % 1.0)
        k *= 0.72 if joint * 2.0 < max(0.004, 0.5 * blur_m) else 1.0
        gloss, sharpness = 0.08, 18.0
    elif material == POSTER:
        r, g, b = _poster_image(x, y, z)
        gloss, sharpness = 0.03, 40.0
    elif material == BOOKS:
        r, g, b = _spine(x, y)
        gloss, sharpness = 0.03, 20.0
    elif material == FABRIC:
        k = 0.9 + 0.2 * noise(x * 90, y * 90, z * 90)
    elif material == METAL:
        gloss, sharpness = 0.10, 30.0
    return r * k, g * k, b * k, gloss, sharpness


@compiled
def _planks(x: float, y: float, blur_m: float) -> float:
    """Return the brightness of a floor of boards along x with different tones and grains."""
    length, width = PLANK_M
    row = math.floor(y / width)
    along = x + hashed(row, 3, 7) * 1.9
    board = math.floor(along / length)
    tone = 0.80 + 0.36 * hashed(row, board, 1)
    grain = noise(x * 3.5 + 17 * row, y * 75, board * 3.1)
    grain = 0.6 * grain + 0.4 * noise(x * 9 + 5 * row, y * 210, board * 1.7)
    across, ahead = (y / width) % 1.0, (along / length) % 1.0
    gap = min(min(across, 1 - across) * width, min(ahead, 1 - ahead) * length)
    seam = 0.0016
    dark = 0.55 if gap < seam else 1.0
    if blur_m > seam:
        dark = 1.0 - 0.45 * min(1.0, seam / blur_m) * (1.0 if gap < blur_m else 0.0)
    return tone * (0.84 + 0.30 * grain) * dark


@compiled
def _poster_image(u: float, v: float, number: float) -> tuple[float, float, float]:
    pick = int(number + 0.5)
    if u < 0.05 or u > 0.95 or v < 0.04 or v > 0.96:
        return 0.75, 0.74, 0.71
    if v < 0.2:  # lines of print
        line = (v * 45) % 1.0
        inked = line < 0.45 and u > 0.1 and u < 0.55 + 0.4 * hashed(math.floor(v * 45), 7, pick)
        return (0.12, 0.12, 0.13) if inked else (0.75, 0.74, 0.71)
    if hashed(pick, 4, 5) < 0.45:
        return _blocks(u, v, pick)
    hills = 0.42 + 0.26 * (noise(u * 3.2, 0.0, pick) - 0.5) + 0.05 * noise(u * 14, 1.0, pick)
    far = 0.64 + 0.2 * (noise(u * 2.3, 7.0, pick) - 0.5)
    hue, shade = hashed(pick, 1, 5), hashed(pick, 2, 5)
    if v < hills:
        k = 0.06 + 0.1 * noise(u * 40, v * 40, pick)
        return k * (0.5 + hue), k * 1.1, k * (1.2 - 0.8 * hue)
    if v < far:
        k = 0.18 + 0.05 * noise(u * 20, v * 20, pick)
        return k * (0.7 + 0.6 * hue), k, k * (1.5 - 0.7 * hue)
    sky = (v - far) / (1.0 - far)
    return 0.62 - 0.5 * sky * shade, 0.56 - 0.3 * sky * shade, 0.38 + 0.3 * hue * sky


@compiled
def _blocks(u: float, v: float, pick: int) -> tuple[float, float, float]:
    """Return the colour of an image of overlapping discs and bars."""
    r, g, b = 0.68, 0.64, 0.56
    for i in range(5):
        du, dv = u - hashed(i, 1, pick), (v - 0.2 - 0.8 * hashed(i, 2, pick)) * 1.3
        size = 0.1 + 0.2 * hashed(i, 3, pick)
        disc = hashed(i, 4, pick) < 0.6
        if (du * du + dv * dv < size * size) if disc else (abs(du) < 0.4 * size):
            tint = hashed(i, 5, pick)
            r, g, b = 0.1 + 0.45 * tint, 0.1 + 0.3 * hashed(i, 6, pick), 0.45 - 0.4 * tint
    return r, g, b


@compiled
def _spine(across_m: float, shelves: float) -> tuple[float, float, float]:
    shelf = math.floor(shelves)
    thick = 0.024 + 0.03 * hashed(math.floor(across_m * 4), shelf, 11)
    book = math.floor(across_m / thick)
    top = 0.62 + 0.26 * hashed(book, shelf, 5)
    height = shelves - shelf
    if height > top or hashed(book, shelf, 9) < 0.08:
        return 0.02, 0.018, 0.016
    edge = (across_m / thick) % 1.0
    k = 0.5 if edge < 0.07 else 1.0
    if abs(height - 0.75 * top) < 0.04:
        k *= 1.5
    grey = 0.03 + 0.3 * hashed(book, shelf, 2) ** 2
    tint, strength = hashed(book, shelf, 1), 0.7 * hashed(book, shelf, 3)
    warm, cold = 1 + strength * (2 * tint - 1), 1 - strength * (2 * tint - 1)
    return k * grey * warm, k * grey * (1 - 0.3 * strength), k * grey * cold
