"""Frames of the virtual lab in the form of a camera, with ground truth."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from common.geometry.boxes import iou_xyxy
from common.geometry.transforms import apply
from lab.camera.frames import FrameRenderer, RenderSettings
from lab.catalogue import load_scenario
from lab.drawing.renderer import DepthView
from lab.truth.frames import PersonView, person_views
from lab.world import World
from people4d.messages import F64, U8, CameraInfo, Detection, RgbdFrame

VISIBLE_MIN = 0.35  # minimum visible share of a person to be found
FACE_AND_TORSO = [0, 5, 6, 11, 12]  # COCO: nose, shoulders, hips
# Scenario, seed and frames of the detector's test split: four people in front of a static camera,
# four in a hall in front of a driving robot, two sitting down.
HELD_OUT = (
    ("four_crossing", 22, range(200, 360, 4)),
    ("pmrm1", 23, range(30, 430, 14)),
    ("short_sit", 24, range(60, 240, 12)),
)
OVERLAP_MIN = 0.4  # minimum overlap of a detection's box with the true box


@dataclass(frozen=True)
class RenderedFrame:
    """One frame and the people to be found in it."""

    frame: RgbdFrame
    info: CameraInfo
    people: Sequence[PersonView]
    positions_m: Sequence[F64]  # [m] positions of these people, optical frame
    map_from_optical: F64  # 4x4


def render(sequences: Sequence[tuple[str, int, range]]) -> Iterator[RenderedFrame]:
    """Draw frames of scenarios, each with seed and indices of its frames."""
    for name, seed, indices in sequences:
        world = World(load_scenario(name), seed)
        renderer = FrameRenderer(world, RenderSettings())
        for index in indices:
            view, t_s = renderer.view(index), world.frame_s(index)
            frame = rgbd_frame(renderer, index, view)
            size = (world.info.height, world.info.width)
            people = [p for p in person_views(world, t_s, view) if has_to_be_found(p, size)]
            optical_from_map = world.optical_from_map(t_s)
            positions_m = [apply(optical_from_map, p.position_m) for p in people]
            yield RenderedFrame(frame, world.info, people, positions_m, world.map_from_optical(t_s))


def rgbd_frame(renderer: FrameRenderer, index: int, view: DepthView) -> RgbdFrame:
    """Draw a frame in the form of the camera."""
    world = renderer.world
    return RgbdFrame(
        stamp_ns=world.stamp_ns(index),
        sequence=index,
        camera=world.info.camera,
        rgb=renderer.rgb(index, view),
        depth_mm=renderer.depth_mm(index, view),
    )


def has_to_be_found(person: PersonView, size: tuple[int, int]) -> bool:
    """Check that enough of a person is visible, face and torso inside the image."""
    return person.visible_share >= VISIBLE_MIN and bool(
        np.all(inside(person, size)[FACE_AND_TORSO])
    )


def inside(person: PersonView, size: tuple[int, int]) -> U8:
    """Return 1 for keypoints inside an image of a height and a width, 17."""
    height, width = size
    u, v = np.nan_to_num(person.keypoints_px, nan=-1.0).T
    return np.asarray((u >= 0) & (v >= 0) & (u < width) & (v < height), np.uint8)


def matches(people: Sequence[PersonView], found: Sequence[Detection]) -> dict[int, Detection]:
    """Return the detection of each found person, by index, matched by the overlap of boxes."""
    if not found or not people:
        return {}
    true = np.array([p.box_xyxy_px for p in people])
    overlap = iou_xyxy(true, np.array([d.box_xyxy_px for d in found], np.float64))
    rows, columns = linear_sum_assignment(-overlap)
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return {i: found[j] for i, j in pairs if overlap[i, j] > OVERLAP_MIN}


def yaw_error_deg(rendered: RenderedFrame, index: int, detection: Detection) -> float:
    """Return the error of a detection's yaw, -180 to 180; NaN if it has no yaw."""
    if detection.heading is None:
        return math.nan
    x, y, _ = rendered.map_from_optical[:3, :3] @ detection.heading
    off_rad = math.atan2(y, x) - rendered.people[index].yaw_rad
    return math.degrees(math.remainder(off_rad, 2 * math.pi))
