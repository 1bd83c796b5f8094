"""Read the named parts of MakeHuman's base mesh."""

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

I32 = npt.NDArray[np.int32]
F64 = npt.NDArray[np.float64]

# Part of the asset -> groups of the base mesh. Tights and skirt are the helper meshes to which
# MakeHuman fits clothes.
PARTS = {
    "body": ("body",),
    "tights": ("helper-tights",),
    "skirt": ("helper-skirt",),
    "hair": ("helper-hair",),
    "eyes": ("helper-l-eye", "helper-r-eye"),
}


def read_parts(path: Path) -> dict[str, I32]:
    """Return the triangles of each part, Fx3 indices of the base mesh's vertices."""
    groups: dict[str, list[tuple[int, int, int]]] = {}
    group = ""
    for line in path.read_text(encoding="utf-8").splitlines():
        word, *rest = line.split() or [""]
        if word == "g":
            group = rest[0]
        elif word == "f":
            corners = [int(corner.split("/")[0]) - 1 for corner in rest]
            groups.setdefault(group, []).extend(
                (corners[0], corners[i], corners[i + 1]) for i in range(1, len(corners) - 1)
            )
    return {
        part: np.array([face for name in names for face in groups[name]], np.int32)
        for part, names in PARTS.items()
    }


def read_masks(mesh: Path, textures: Path, names: tuple[str, ...]) -> dict[str, F64]:
    """Return the weight, 0 to 1, of each vertex in painted regions of the skin.

    Args:
        mesh: The base mesh.
        textures: Folder of the masks, images in texture coordinates.
        names: Names of the masks.
    """
    positions = texture_positions(mesh)
    masks = {}
    for name in names:
        read = cv2.imread(str(textures / f"mpfb_{name}.jpg"), cv2.IMREAD_GRAYSCALE)
        if read is None:
            raise FileNotFoundError(f"there is no mask {name} in {textures}")
        image = read / 255
        rows = np.clip((1 - positions[:, 1]) * len(image), 0, len(image) - 1).astype(int)
        columns = np.clip(positions[:, 0] * image.shape[1], 0, image.shape[1] - 1).astype(int)
        masks[name] = image[rows, columns]
    return masks


def texture_positions(mesh: Path) -> F64:
    """Return one texture coordinate of each vertex, Vx2; 0 if it has none."""
    coordinates: list[list[float]] = []
    corners: set[tuple[int, int]] = set()
    vertices = 0
    for line in mesh.read_text(encoding="utf-8").splitlines():
        word, *rest = line.split() or [""]
        if word == "v":
            vertices += 1
        elif word == "vt":
            coordinates.append([float(rest[0]), float(rest[1])])
        elif word == "f":
            corners |= {tuple(int(i) - 1 for i in corner.split("/")[:2]) for corner in rest}  # type: ignore[misc]
    positions = np.zeros((vertices, 2))
    for vertex, position in sorted(corners):
        positions[vertex] = coordinates[position]
    return positions
