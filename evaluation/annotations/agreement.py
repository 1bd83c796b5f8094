"""Agreement of two annotators of one recording."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from common.geometry.transforms import LINK_FROM_OPTICAL
from evaluation.annotations.images import AnnotatedImages, read_images
from evaluation.annotations.marks import Annotations, Mark, check_recording, read_annotations
from people4d.errors import SourceError
from people4d.messages import F64
from services.camera.config import CameraConfig
from services.tracker.sort3d.association import assign

APART_M = 0.5  # maximum distance of two marks of one person across the view [m]
DEPTH_M = 3.0  # assumed depth of a mark without depth [m]


@dataclass(frozen=True)
class _Pair:
    """Marks of one person by both annotators, with their points on the ground."""

    first: Mark
    second: Mark
    points_m: tuple[F64 | None, F64 | None]


@dataclass(frozen=True)
class Agreement:
    """Agreement of two annotators over the frames that both have annotated."""

    frames: int
    marks: tuple[int, int]  # number of marks of each
    pairs: int  # number of people marked by both
    same_identity: int  # number of pairs with the same person, names being matched one to one
    same_hidden: int
    distances_m: tuple[float, ...]  # distances on the ground, of pairs with depth
    differences_deg: tuple[float, ...]  # differences of facing, of pairs with both

    def rows(self) -> Iterator[tuple[str, str, str]]:
        """Yield quantity, value and number of samples as text."""
        yield "annotated images", str(self.frames), ""
        yield "people marked by both", *_share(2 * self.pairs, sum(self.marks))
        yield "same identity", *_share(self.same_identity, self.pairs)
        yield "same occlusion", *_share(self.same_hidden, self.pairs)
        yield "distance on the ground, median", *_middle(self.distances_m, "{:.2f} m")
        yield "difference of facing, median", *_middle(self.differences_deg, "{:.0f}°")


def agreement(camera: CameraConfig, first: Path, second: Path) -> Agreement:
    """Compare two files of annotations of the recording of a camera.

    SourceError if a file cannot be read, belongs to another recording, or no frame is in both.
    """
    files = [read_annotations(path) for path in (first, second)]
    common = files[0].frames.keys() & files[1].frames.keys()
    if not common:
        raise SourceError(f"{first} and {second} have no annotated frame in common")
    images = read_images(camera, 1, lambda _: None, common)
    for path, annotations in zip((first, second), files, strict=True):
        check_recording(path, annotations, images.digest)
    common &= images.images.keys()
    pairs = [pair for frame in sorted(common) for pair in _pairs(images, frame, files)]
    apart = [
        (p, q) for pair in pairs for p, q in [pair.points_m] if p is not None and q is not None
    ]
    yaws = [(pair.first.yaw_deg, pair.second.yaw_deg) for pair in pairs]
    return Agreement(
        frames=len(common),
        marks=(_count(files[0], common), _count(files[1], common)),
        pairs=len(pairs),
        same_identity=_same_identity(pairs),
        same_hidden=sum(pair.first.hidden == pair.second.hidden for pair in pairs),
        distances_m=tuple(float(np.linalg.norm((p - q)[:2])) for p, q in apart),
        differences_deg=tuple(
            abs(math.remainder(a - b, 360)) for a, b in yaws if a is not None and b is not None
        ),
    )


def _pairs(images: AnnotatedImages, frame: int, files: Sequence[Annotations]) -> Iterator[_Pair]:
    """Yield the marks of the same people in a frame, by their distance across the view."""
    firsts, seconds = (file.frames[frame] for file in files)
    points = [images.points_m(frame, marks, LINK_FROM_OPTICAL) for marks in (firsts, seconds)]
    apart_m = np.full((len(firsts), len(seconds)), np.inf)
    for i, a in enumerate(firsts):
        for j, b in enumerate(seconds):
            point_m = points[1][j] if points[0][i] is None else points[0][i]
            depth_m = DEPTH_M if point_m is None else point_m[0]
            across_m = math.hypot(a.u_px - b.u_px, a.v_px - b.v_px) * depth_m / images.info.fx
            apart_m[i, j] = across_m if across_m <= APART_M else np.inf
    for i, j in assign(apart_m):
        yield _Pair(firsts[i], seconds[j], (points[0][i], points[1][j]))


def _same_identity(pairs: Sequence[_Pair]) -> int:
    """Return the number of pairs under the best one-to-one assignment of names."""
    names = [sorted({getattr(p, side).person for p in pairs}) for side in ("first", "second")]
    together = np.zeros((len(names[0]), len(names[1])), np.int64)
    for pair in pairs:
        together[names[0].index(pair.first.person), names[1].index(pair.second.person)] += 1
    return int(together[linear_sum_assignment(together, maximize=True)].sum())


def _count(annotations: Annotations, frames: set[int]) -> int:
    return sum(len(annotations.frames[frame]) for frame in frames)


def _share(part: int, total: int) -> tuple[str, str]:
    return f"{100 * part / total:.0f} %" if total else "-", str(total)


def _middle(values: Sequence[float], form: str) -> tuple[str, str]:
    return form.format(float(np.median(values))) if values else "-", str(len(values))
