"""Read the named parts of MakeHuman's base mesh."""

from pathlib import Path

import numpy as np
import numpy.typing as npt

I32 = npt.NDArray[np.int32]

# Part of the asset -> groups of the base mesh. The tights and the skirt are the helpers to which
# MakeHuman fits clothes: they follow the shape of each body.
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
