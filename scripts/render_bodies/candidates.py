"""Candidates of people in rendered images, as the body network gets them, with their labels."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from lab.drawing.renderer import DepthView, Instant, body_extents, draw_depth
from people4d.messages import F32, F64, U8, U16, CameraInfo
from scripts.render_bodies.boxes import detector_box, empty_box, layer_depths
from scripts.render_bodies.labels import MARGIN_PX, Kind
from scripts.render_bodies.scenes import (
    FURNITURE_OWNER,
    Subject,
    draw_furniture,
    draw_subjects,
    draw_viewpoint,
)
from scripts.render_bodies.sensors import measure
from scripts.render_people.outfits import Rng
from scripts.render_people.views import DARK_SCENES, PEOPLE, Identity, Stage, draw_identity
from services.detector.position.body import BodyNetwork, offset_axes
from services.detector.position.surface import DepthImage

BASELINE_M = 0.05  # baseline of the depth cameras [m]
VISIBLE_MIN = 60  # minimum number of visible pixels of a person
FURNITURE_MIN = 100  # minimum number of visible pixels of furniture
BOX_MIN_PX = (5, 8)  # minimum width and height of a box [px]
OWN_LAYER = 0.75  # share of people's boxes at the depth of the layer next to the torso
AXIS_M = 0.1  # typical distance of the torso's middle behind the layer [m]
LAYER_SIGMA = 0.01  # standard deviation of layers, relative
DEPTHS_M = (0.3, 12.0)  # limits of layers [m]
HEIGHT_M = 1.7  # height of a box without readings [m]
UNREAD = 0.5  # share of boxes without readings that are candidates
# Typical offset of the torso's middle along the line of sight, and the maximum difference from it:
# beyond, the layer belongs to something else [m]
ALONG_M, OTHER_M = 0.12, 0.6
SURROUNDED = {Kind.FURNITURE: 0.08, Kind.EMPTY: 0.06}  # maximum shares of people in such boxes


class Label(NamedTuple):
    """Truth about a box."""

    kind: Kind
    share: float = 0.0  # visible share of the body, 0 to 1
    torso_m: F64 | None = None  # 3, middle of the torso, optical frame; None: no body


@dataclass(frozen=True)
class Image:
    """Rendered image, with its truth."""

    rgb: U8
    depth_mm: U16
    view: DepthView
    subjects: Sequence[Subject]
    pieces: int  # number of pieces of furniture
    info: CameraInfo
    optical_from_map: F64

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.info.width, self.info.height


class Samples(NamedTuple):
    """Candidates with labels; the axes of offsets are right, down, and along the line of sight."""

    colours: U8  # Nx3x54x38
    depths: npt.NDArray[np.int8]  # Nx4x54x38 channels of depth, -127 to 127
    # Nx3, from the reference point to the torso's middle; NaN if unknown, or without a body
    offsets_m: F32
    kinds: U8  # N, see `Kind`
    shares: F32  # N visible shares of bodies, 0 to 1

    @classmethod
    def of_images(
        cls, images: F32, offsets_m: F64, kinds: U8, shares: Sequence[float]
    ) -> "Samples":
        """Return samples from images of `BodyNetwork.candidates`."""
        return cls(
            np.rint(images[:, :3] * 255).astype(np.uint8),
            np.rint(images[:, 3:] * 127).astype(np.int8),
            offsets_m.astype(np.float32),
            kinds,
            np.array(shares, np.float32),
        )


def samples_of_scene(rng: Rng, stage: Stage, images: int) -> Iterator[Samples]:
    """Yield the samples of the images of a scene; half of the images show one room."""
    dark = bool(rng.random() < DARK_SCENES)
    people = [draw_identity(rng, stage, dark) for _ in range(PEOPLE)]
    home = int(rng.integers(len(stage.rooms)))
    for number in range(images):
        room = home if number < images // 2 else int(rng.integers(len(stage.rooms)))
        image = draw_image(rng, stage, people, room)
        if image is not None and (samples := draw_samples(rng, image)) is not None:
            yield samples


def draw_image(rng: Rng, stage: Stage, people: Sequence[Identity], number: int) -> Image | None:
    """Draw people, things and furniture in a room; None if it is empty."""
    room, renderer = stage.rooms[number]
    viewpoint = draw_viewpoint(rng, room)
    taken = [viewpoint.at_m[:2]]
    subjects = draw_subjects(rng, stage, people, viewpoint, taken)
    furniture = draw_furniture(rng, viewpoint, taken)
    meshes = [*(subject.mesh for subject in subjects), *furniture]
    if not meshes:
        return None
    pose = viewpoint.optical_from_map
    rgb = renderer.exposed([Instant(meshes, pose)], int(rng.integers(2**31)))
    view = draw_depth([renderer.room.mesh, *meshes], pose, renderer.info, BASELINE_M)
    depth_mm = measure(rng, view, renderer.info)
    return Image(rgb, depth_mm, view, subjects, len(furniture), renderer.info, pose)


def draw_samples(rng: Rng, image: Image) -> Samples | None:
    """Return the samples of an image; None if it has none."""
    labels, boxes_px, layers_m = list[Label](), list[F64](), list[float]()
    for label, box_px in labelled_boxes(rng, image):
        layer_m = draw_layer(rng, image, box_px, label)
        if layer_m is not None:
            labels.append(label)
            boxes_px.append(box_px)
            layers_m.append(layer_m)
    if not labels:
        return None
    images, points_m = BodyNetwork.candidates(
        np.array(boxes_px),
        np.array(layers_m),
        image.rgb,
        DepthImage(image.depth_mm, image.info),
        MARGIN_PX,
    )
    offsets_m = np.array(
        [
            np.full(3, np.nan) if label.torso_m is None else axes @ (label.torso_m - point_m)
            for label, point_m, axes in zip(
                labels, points_m, map(offset_axes, points_m), strict=True
            )
        ]
    )
    kinds = np.array([label.kind for label in labels], np.uint8)
    other = np.abs(offsets_m[:, 2] - ALONG_M) > OTHER_M
    kinds[(kinds == Kind.PERSON) & other] = Kind.OTHER_LAYER
    return Samples.of_images(images, offsets_m, kinds, [label.share for label in labels])


def labelled_boxes(rng: Rng, image: Image) -> Iterator[tuple[Label, F64]]:
    """Yield boxes of people and things, of furniture, and of empty positions."""
    yield from subject_boxes(rng, image)
    people = np.isin(image.view.owners, [subject.owner for subject in image.subjects])
    for k in range(image.pieces):
        own = image.view.owners == FURNITURE_OWNER + k
        if np.count_nonzero(own) < FURNITURE_MIN or rng.random() < 0.3:
            continue
        bounds_px = bounding_box(own)
        box_px = detector_box(rng, bounds_px, bounds_px, [], image.size_px)
        if people_share(people, box_px) < SURROUNDED[Kind.FURNITURE]:
            yield Label(Kind.FURNITURE), box_px
    for _ in range(2):
        box_px = empty_box(rng, image.size_px, image.info.fy)
        if people_share(people, box_px) < SURROUNDED[Kind.EMPTY]:
            yield Label(Kind.EMPTY), box_px


def subject_boxes(rng: Rng, image: Image) -> Iterator[tuple[Label, F64]]:
    """Yield one or two boxes of each visible person or thing."""
    visible, counts = dict[int, F64](), dict[int, int]()
    for subject in image.subjects:
        own = image.view.owners == subject.owner
        count = int(np.count_nonzero(own))
        if count >= VISIBLE_MIN:
            visible[subject.owner] = bounding_box(own)
            counts[subject.owner] = count
    for subject in image.subjects:
        if subject.owner not in visible:
            continue
        extent = body_extents(subject.mesh, image.optical_from_map, image.info)
        share = min(1.0, counts[subject.owner] / max(extent.pixels, 1))
        label = Label(subject.kind, share, subject.torso_m)
        others = [box_px for owner, box_px in visible.items() if owner != subject.owner]
        for _ in range(1 if rng.random() < 0.6 else 2):
            own_px = visible[subject.owner]
            yield label, detector_box(rng, own_px, extent.box_xyxy_px, others, image.size_px)


def draw_layer(rng: Rng, image: Image, box_px: F64, label: Label) -> float | None:
    """Draw the depth of a candidate [m]; None if the box is not a candidate."""
    width, height = (box_px[2:] - box_px[:2]).tolist()
    if width < BOX_MIN_PX[0] or height < BOX_MIN_PX[1]:
        return None
    layers_m = layer_depths(image.depth_mm, box_px, image.info.fy)
    if not layers_m:
        if rng.random() < 1 - UNREAD:
            return None
        layers_m = [HEIGHT_M * image.info.fy / height]
    if label.torso_m is not None and rng.random() < OWN_LAYER:
        expected_m = label.torso_m[2] - AXIS_M
        layer_m = min(layers_m, key=lambda depth_m: abs(expected_m - depth_m))
    else:
        layer_m = layers_m[rng.integers(len(layers_m))]
    layer_m *= 1 + rng.normal(0, LAYER_SIGMA)
    return layer_m if DEPTHS_M[0] < layer_m < DEPTHS_M[1] else None


def bounding_box(pixels: npt.NDArray[np.bool_]) -> F64:
    """Return left, top, right and bottom of pixels, at least one."""
    rows, columns = np.flatnonzero(pixels.any(axis=1)), np.flatnonzero(pixels.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], np.float64)


def people_share(people: npt.NDArray[np.bool_], box_px: F64) -> float:
    """Return the share of a box that people cover, 1 if it has no pixels."""
    left, top, right, bottom = box_px.astype(int)
    inside = people[top:bottom, left:right]
    return float(inside.mean()) if inside.size else 1.0
