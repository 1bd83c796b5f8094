"""Boxes from a camera that moves, with ground truth and odometry."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from common.geometry.transform_buffer import transform_from_odometry
from common.geometry.transform_history import COUNTERS, TransformHistory
from common.geometry.transforms import LINK_FROM_OPTICAL
from common.metrics.record import BOOL, EvaluationFrame, EvaluationSequence, GroundTruth, Hypotheses
from lab.camera.frames import odometry as lab_odometry
from lab.camera.synthetic_detections import SyntheticDetections, SyntheticDetectionsConfig
from lab.catalogue import load_scenario
from lab.truth.silhouette import silhouettes
from lab.world import World
from people4d.messages import F64, Detections, Odometry
from services.tracker.image_sort.camera_turn import camera_direction, turn_between
from services.tracker.image_sort.image_sort import BoxFrame, BoxTracks

VISIBLE_MIN = 0.35  # minimum visible share of a person to be found
WAIT_S = 0.05


@dataclass(frozen=True)
class Sample:
    """A message of odometry and its arrival."""

    odometry: Odometry
    arrival_ns: int  # [ns] time of arrival, on the clock of the frames' stamps


@dataclass(frozen=True)
class Ride:
    """One recording of a moving camera."""

    name: str
    frames: tuple[BoxFrame, ...]
    truth: tuple[GroundTruth, ...]  # truth of each frame
    samples: tuple[Sample, ...]  # odometry in the order of arrival
    fov_deg: float  # [deg] field of view of the camera

    def turned(self) -> tuple[BoxFrame, ...]:
        """Return the frames with the turns that odometry gives at their arrival."""
        if not self.samples:
            return self.frames
        base = TransformHistory(Counter(dict.fromkeys(COUNTERS, 0)))
        before, waiting, frames = None, list(self.samples), []
        for frame in self.frames:
            latest_ns = frame.stamp_ns + int(WAIT_S * 1e9)
            while waiting and waiting[0].arrival_ns <= latest_ns:
                came_ns = waiting[0].arrival_ns
                if came_ns > frame.stamp_ns and (base.newest_ns or 0) >= frame.stamp_ns:
                    break
                odometry = waiting.pop(0).odometry
                base.add_sample(odometry.stamp_ns, transform_from_odometry(odometry))
            pose = base.at(frame.stamp_ns)
            now = None
            if pose:
                now = camera_direction(pose.matrix @ LINK_FROM_OPTICAL, pose.sigma_rad)
            frames.append(replace(frame, turn=turn_between(before, now)))
            before = now
        return tuple(frames)

    def scored(self, published: Sequence[BoxTracks]) -> EvaluationSequence:
        """Return truth and tracks of a ride as one sequence."""
        people = [
            Hypotheses(ids=tuple(t.ids.tolist()), boxes_xyxy_px=t.boxes_xyxy_px) for t in published
        ]
        frames = [
            EvaluationFrame(stamp_ns=f.stamp_ns, truth=truth, hypotheses=tracked)
            for f, truth, tracked in zip(self.frames, self.truth, people, strict=True)
        ]
        return EvaluationSequence(self.name, tuple(frames))


def lab_ride(scenario: str, seed: int, errors: SyntheticDetectionsConfig) -> Ride:
    """Return a scenario of the virtual lab with synthetic detections, without images."""
    world = World(load_scenario(scenario), seed)
    synthetic = SyntheticDetections(errors, world.info, seed)
    frames, truth = [], []
    for index in range(world.frame_count):
        t_s, stamp_ns = world.frame_s(index), world.stamp_ns(index)
        people, optical_from_map = world.keypoints_m(t_s), world.optical_from_map(t_s)
        frames.append(_boxes(synthetic.at(people, optical_from_map, stamp_ns)))
        found = silhouettes(people, optical_from_map, world.info)
        boxes = np.array([found[k].box_xyxy_px for k in found]).reshape(-1, 4)
        shares = np.array([found[k].visible_share for k in found])
        truth.append(_truth(list(found), boxes, shares, frames[-1].size_px))
    return Ride(
        f"{scenario}@{seed}",
        tuple(frames),
        tuple(truth),
        _prompt(lab_odometry(world)),
        _fov_deg(world.info.width, world.info.fx),
    )


def kitti_ride(folder: Path, seed: int) -> Ride:
    """Return a drive through a street: true boxes with a detector's errors, poses as odometry.

    A fifth of the people is missed, often for two frames; sides of boxes are off by 2 % of the
    height; one false alarm in ten frames.
    """
    rng, size_px, focal_px = np.random.default_rng(seed), (1238, 374), 718.3351
    poses = np.loadtxt(folder / "CameraTrajectory.txt").reshape(-1, 3, 4)
    people: list[dict[int, F64]] = [{} for _ in poses]
    for line in (folder / "labels.txt").read_text(encoding="utf-8").splitlines():
        cells = line.split()
        if cells[2] in ("Pedestrian", "Cyclist", "Person_sitting"):
            people[int(cells[0])][int(cells[1])] = np.array(cells[6:10], np.float64)
    missing: dict[int, bool] = {}
    frames, truth, before = list[BoxFrame](), list[GroundTruth](), None
    for here, pose in zip(people, poses, strict=True):
        boxes = list[F64]()
        for identity, box in here.items():
            lasts = rng.random() < (0.5 if missing.get(identity) else 0.875)
            missing[identity] = missing.get(identity, False) == lasts
            if not missing[identity]:
                boxes.append(box + rng.normal(0, 0.02 * (box[3] - box[1]), 4))
        if rng.random() < 0.1:
            corner, tall = rng.uniform(0, [size_px[0] - 60, size_px[1] - 150]), rng.uniform(40, 150)
            boxes.append(np.array([*corner, corner[0] + 0.4 * tall, corner[1] + tall]))
        scores = rng.uniform(0.5, 1.0, len(boxes))
        direction = camera_direction(LINK_FROM_OPTICAL[:3, :3] @ pose)
        turn, before = turn_between(before, direction), direction
        found, stamp_ns = np.array(boxes).reshape(-1, 4), len(frames) * 100_000_000
        frames.append(BoxFrame(stamp_ns, found, scores, size_px, turn))
        shown = np.array(list(here.values())).reshape(-1, 4)
        truth.append(GroundTruth(ids=tuple(here), boxes_xyxy_px=shown))
    name, fov_deg = f"kitti_0019@{seed}", _fov_deg(size_px[0], focal_px)
    return Ride(name, tuple(frames), tuple(truth), (), fov_deg)


def _truth(ids: list[int], boxes: F64, shares: F64, size_px: tuple[int, int]) -> GroundTruth:
    """Return the people in the image; heavily occluded people are optional."""
    boxes = boxes.clip(0, [*size_px, *size_px])
    inside: BOOL = np.all(boxes[:, :2] < boxes[:, 2:], axis=1) & (shares > 0)
    return GroundTruth(
        ids=tuple(k for k, there in zip(ids, inside, strict=True) if there),
        boxes_xyxy_px=boxes[inside],
        occluded=shares[inside] < VISIBLE_MIN,
    )


def _boxes(detections: Detections) -> BoxFrame:
    people = detections.detections
    boxes = np.array([p.box_xyxy_px for p in people], np.float64).reshape(-1, 4)
    scores, size_px = np.array([p.score for p in people]), (detections.width, detections.height)
    return BoxFrame(detections.stamp_ns, boxes, scores, size_px)


def _prompt(published: Sequence[Odometry]) -> tuple[Sample, ...]:
    return tuple(Sample(one, one.stamp_ns) for one in published)


def _fov_deg(width: int, focal_px: float) -> float:
    return math.degrees(2 * math.atan(width / 2 / focal_px))
