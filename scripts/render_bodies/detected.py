"""Candidates that the detector finds in furnished rooms, with people or with other things."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from msgspec.structs import replace

from common.geometry.transforms import apply
from lab.camera.frames import FrameRenderer, RenderSettings
from lab.catalogue import load_scenario
from lab.furniture import ObjectKind
from lab.world import World
from people4d.messages import F64
from scripts.render_bodies.candidates import ALONG_M, Samples
from scripts.render_bodies.labels import MARGIN_PX, Kind
from scripts.render_bodies.scenes import TORSO
from services.detector.config import DetectorConfig
from services.detector.models.base import PersonModel
from services.detector.models.registry import load_model
from services.detector.position.body import BodyNetwork
from services.detector.position.surface import DepthImage
from services.detector.position.torso import find_torsos

FIRST_SEED = 1000  # seed of the first room of each content
ROOMS = ("office", "hall", "lab")
STILL, MOVING = (0, 1), (10, 30, 50, 70)  # frames of rooms without and with people
NEAR_M = 0.35  # maximum distance of a person from a true torso, along the floor [m]


@dataclass(frozen=True)
class Content:
    """Content of furnished rooms, and the label of all detections."""

    kind: Kind
    rooms: int  # number of rooms of a file
    thing: ObjectKind | None = None  # kind of two objects that look like people; None: no objects


CONTENTS = {
    "furniture": Content(Kind.FURNITURE, 92),
    "poster": Content(Kind.FLAT_FIGURE, 8, "poster"),
    "screen": Content(Kind.FLAT_FIGURE, 18, "screen"),
    "robot": Content(Kind.ROBOT, 50, "robot"),
    "people": Content(Kind.PERSON, 12),
}


def detect_part(content: Content, part: int) -> Samples:
    """Return the samples of the rooms of a part."""
    model, first = load_model(DetectorConfig()), FIRST_SEED + part * content.rooms
    seeds = range(first, first + content.rooms)
    found = [samples for seed in seeds for samples in samples_of_room(content, seed, model)]
    return Samples(*map(np.concatenate, zip(*found, strict=True)))


def samples_of_room(content: Content, seed: int, model: PersonModel) -> Iterator[Samples]:
    """Yield the samples of the frames of a room; people far from all true ones are skipped."""
    world, confidence_min = draw_world(content, seed), DetectorConfig().confidence_for(model.name)
    renderer = FrameRenderer(world, RenderSettings(samples=1))
    for index in MOVING if world.scenario.people else STILL:
        frame = renderer.capture(index)
        image = DepthImage(frame.depth_mm, world.info)
        torsos = [t for t in find_torsos(model.detect(frame.rgb), confidence_min, image) if t]
        if not torsos:
            continue
        boxes_px = np.array([torso.joints.box_xyxy_px for torso in torsos])
        layers_m = np.array([torso.layer.depth_m for torso in torsos])
        images, points_m = BodyNetwork.candidates(boxes_px, layers_m, frame.rgb, image, MARGIN_PX)
        if content.kind == Kind.PERSON:
            images = images[near_people(world, world.frame_s(index), points_m)]
        count = len(images)
        unknown_m, kinds = np.full((count, 3), np.nan), np.full(count, content.kind, np.uint8)
        yield Samples.of_images(images, unknown_m, kinds, [1.0] * count)


def draw_world(content: Content, seed: int) -> World:
    """Draw a room with its content, and a camera without motion blur."""
    room, objects = ROOMS[seed % len(ROOMS)], 2 if content.thing else 0
    options = f"room={room}&people={2 + seed % 4}&objects={objects}&duration_s=8"
    scenario = load_scenario(f"random?{options}", seed)
    people = scenario.people if content.kind == Kind.PERSON else ()
    things = tuple(replace(one, kind=content.thing) for one in scenario.objects)
    camera = replace(scenario.camera, exposure_s=0.0)
    return World(replace(scenario, people=people, objects=things, camera=camera), seed)


def near_people(world: World, t_s: float, points_m: F64) -> npt.NDArray[np.bool_]:
    """Return True for each point in a layer of depth (Nx3, optical frame) before a true torso."""
    torsos_m = np.array([joints_m[TORSO].mean(axis=0) for joints_m in world.keypoints_m(t_s)])
    torsos_m = apply(world.optical_from_map(t_s), torsos_m) - [0, 0, ALONG_M]
    right_m, _, along_m = np.moveaxis(torsos_m - points_m[:, None], 2, 0)
    return np.asarray((np.hypot(right_m, along_m) < NEAR_M).any(axis=1))
