"""Tracks and skeletons of a simulated scene, without images."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from common.runtime.node import Node
from lab.camera.frames import transforms
from lab.camera.synthetic_detections import SyntheticDetections, SyntheticDetectionsConfig
from lab.depth.config import SENSORS
from lab.motion.acts import posture
from lab.world import World
from people4d.messages import (
    F64,
    Detections,
    Message,
    PersonSkeleton,
    Skeletons,
    Track,
    Tracks,
)
from services.skeleton.build import build as build_skeleton
from services.skeleton.config import SkeletonConfig
from services.tracker.build import build as build_tracker
from services.tracker.config import TrackerConfig

NEAR_M = 0.6  # maximum distance of a track from its person [m]
WALKING_MPS, STANDING_MPS = 0.4, 0.1  # speeds above and below which a person walks and stands
SETTLED_S = 0.5  # time around a change of posture that is not scored [s]
TORSO = [5, 6, 11, 12]


@dataclass(frozen=True)
class Frame:
    """One frame of a scene: messages, and the track and skeleton of each person."""

    time_s: float
    detections: Detections
    messages: tuple[Message, ...]  # tracks and skeletons
    keypoints_m: list[F64]  # true joints of each person, 17x3
    skeletons: list[PersonSkeleton | None]  # skeleton of each person
    tracks: list[Track | None]  # track of each person


def frames(
    world: World, joints_m: Callable[[World, float], list[F64]] = World.keypoints_m
) -> Iterator[Frame]:
    """Yield the frames of a scene with the output of tracker and skeletons.

    Args:
        world: Scene.
        joints_m: Joints of all figures at a time, 17x3 each.
    """
    config = SyntheticDetectionsConfig(keypoint_depths=True, sensor=SENSORS["d435i"])
    detector = SyntheticDetections(config, world.info, world.noise_seed)
    tracker, skeleton = build_tracker(TrackerConfig()), build_skeleton(SkeletonConfig())
    for message in (world.info, *transforms(world)):
        for node in (tracker, skeleton):
            node.handle(message, 0)
    for index in range(world.frame_count):
        time_s = world.frame_s(index)
        people = joints_m(world, time_s)
        found = detector.at(people, world.optical_from_map(time_s), world.stamp_ns(index), index)
        skeleton.handle(found, 0)
        messages: list[Message] = list(_outputs(tracker, found, found.stamp_ns))
        for tracks in [one for one in messages if isinstance(one, Tracks)]:
            messages += skeleton.handle(tracks, 0)
        yield _frame(time_s, found, tuple(messages), people)


def _outputs(node: Node, message: Message, now_ns: int) -> list[Message]:
    return [*node.handle(message, now_ns), *node.tick(now_ns)]


def _frame(
    time_s: float, found: Detections, messages: tuple[Message, ...], people: list[F64]
) -> Frame:
    tracks = [track for one in messages if isinstance(one, Tracks) for track in one.tracks]
    joints = {
        person.id: person for one in messages if isinstance(one, Skeletons) for person in one.people
    }
    nearest: list[Track | None] = []
    for person in people:
        middle = person[TORSO].mean(axis=0)
        near = sorted(tracks, key=lambda t: float(np.linalg.norm(t.position_m - middle)))
        is_near = near and np.linalg.norm(near[0].position_m - middle) < NEAR_M
        nearest.append(near[0] if is_near else None)
    skeletons = [None if track is None else joints.get(track.id) for track in nearest]
    return Frame(time_s, found, messages, people, skeletons, nearest)


def true_posture(world: World, person: int, time_s: float) -> str | None:
    """Return the true posture at a time; None near a change."""
    plan, motion = world.scenario.people[person], world.motions[person]
    around = [time_s - SETTLED_S, time_s, time_s + SETTLED_S]
    labels = {posture(plan.acts, t) for t in around}
    if len(labels) > 1:
        return None
    (label,) = labels
    if label != "standing":
        return label
    path = motion.path(np.arange(time_s - 0.5, time_s + 0.51, 0.1))
    speeds = np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1) / 0.1
    if speeds.min() > WALKING_MPS:
        return "walking"
    return "standing" if speeds.max() < STANDING_MPS else None
