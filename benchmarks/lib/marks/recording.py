"""An annotated recording, and the tracks of a method in its images."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.lib.marks.scores import MarkTruth, TrackedPerson
from common.geometry.transforms import apply, invert, project
from evaluation.annotations.marks import Mark, MarkView
from evaluation.methods import Method
from evaluation.recordings.detections import (
    DetectionFiles,
    DetectionJob,
    detect,
    read_tracker_input,
)
from people4d.messages import (
    F64,
    CameraInfo,
    Detection,
    Detections,
    ImageTracks,
    Message,
    Track,
    Tracks,
)
from services.camera.config import CameraConfig
from services.camera.source import SourceFrame
from services.camera.sources import open_source
from services.tracker.build import build as build_tracker
from services.tracker.observe import yaw_of

# Half width and half height of the box around a predicted person
PREDICTED_HALF_M = (0.3, 0.9)
TORSO_ABOVE = 0.35  # share of the height of the box above the torso


@dataclass(frozen=True)
class FrameOutput:
    """Messages of a method for one frame."""

    detections: Detections
    tracks: Tracks
    boxes: ImageTracks | None  # output of a tracker in the image


@dataclass(frozen=True)
class MarkedRecording:
    """A recording with its annotations."""

    camera: CameraConfig
    view: MarkView
    truth: dict[int, tuple[MarkTruth, ...]]  # annotations by frame

    def hypotheses(self, outputs: Sequence[FrameOutput]) -> dict[int, list[TrackedPerson]]:
        """Return the tracks in the image by frame."""
        return {frame: list(self._tracked(one)) for frame, one in enumerate(outputs)}

    def detected(self, found: Iterable[Detections]) -> dict[int, list[TrackedPerson]]:
        """Return the detections of all frames as tracks of one frame each."""
        tracked, number = dict[int, list[TrackedPerson]](), 0
        for frame, one in enumerate(found):
            tracked[frame] = []
            for detection in one.detections:
                number += 1
                tracked[frame].append(self._of_detection(number, detection))
        return tracked

    def _of_detection(self, number: int, detection: Detection) -> TrackedPerson:
        pose = self.view.map_from_optical
        found_m = detection.position_m
        return TrackedPerson(
            id=number,
            box_xyxy_px=np.asarray(detection.box_xyxy_px, np.float64),
            position_m=None if found_m is None else np.asarray(apply(pose, found_m)),
            yaw_rad=yaw_of(detection.heading, pose),
        )

    def _tracked(self, one: FrameOutput) -> Iterator[TrackedPerson]:
        boxes = {t.id: t for t in one.boxes.tracks} if one.boxes else {}
        tracks = {t.id: t for t in one.tracks.tracks}
        for id_ in boxes.keys() | tracks.keys():
            track, box = tracks.get(id_), boxes.get(id_)
            found = box.detection if box else track.detection if track else None
            if box:
                corners: F64 | None = box.box_xyxy_px
            elif found is not None:
                detection = one.detections.detections[found]
                corners = np.asarray(detection.box_xyxy_px, np.float64)
            else:
                assert track is not None
                corners = self._predicted_box(track)
            if corners is not None:
                yield TrackedPerson(
                    id=id_,
                    box_xyxy_px=corners,
                    predicted=found is None,
                    position_m=track.position_m if track else None,
                    yaw_rad=track.yaw_rad if track else None,
                )

    def _predicted_box(self, track: Track) -> F64 | None:
        """Return the box around a predicted person; None out of the image."""
        info = self.view.info
        point_m = np.asarray(apply(invert(self.view.map_from_optical), track.position_m))
        if point_m[2] <= 0:
            return None
        ((u, v),) = project(point_m, info)
        if not (0 <= u < info.width and 0 <= v < info.height):
            return None
        half = np.array(PREDICTED_HALF_M) * (info.fx, info.fy) / point_m[2]
        top = v - 2 * half[1] * TORSO_ABOVE
        return np.array([u - half[0], top, u + half[0], top + 2 * half[1]])


def read_images(camera: CameraConfig) -> tuple[CameraInfo, list[SourceFrame]]:
    """Return calibration and images of a recording, depth registered to colour."""
    source = open_source(camera.source, camera.options)
    return source.info, [item for item in source if isinstance(item, SourceFrame)]


def marked(
    camera: CameraConfig, marks: Mapping[int, Sequence[Mark]]
) -> tuple[MarkedRecording, list[SourceFrame]]:
    """Return a recording with its annotations, and its images."""
    info, images = read_images(camera)
    view = MarkView(info, camera.mount_from_optical)
    truth = {
        frame: tuple(
            MarkTruth(mark, view.point_m(mark, images[frame].depth_mm), view.yaw_rad(mark))
            for mark in people
        )
        for frame, people in marks.items()
    }
    return MarkedRecording(camera, view, truth), images


def detect_all(method: Method, camera: CameraConfig, cache: Path) -> DetectionFiles:
    """Return the detections and embeddings of a recording, cached."""
    reids = tuple(filter(None, [method.reid]))
    return detect(DetectionJob(Path(camera.source), camera, method.detector, reids, cache))


def run(method: Method, camera: CameraConfig, cache: Path) -> list[FrameOutput]:
    """Play a recording through a method; its detections are cached."""
    files = detect_all(method, camera, cache)
    messages = read_tracker_input(files.detections, next(iter(files.embeddings), None))
    # Embeddings come before their detections here; later ones do not exist.
    config = msgspec.structs.replace(method.tracker, embedding_wait_s=0.0, reorder_wait_s=0.0)
    node, outputs = build_tracker(config), list[FrameOutput]()
    for message in messages:
        published: Iterable[Message] = node.handle(message, 0)
        if not isinstance(message, Detections):
            continue
        published = list(published)
        tracks = next(m for m in published if isinstance(m, Tracks))
        boxes = next((m for m in published if isinstance(m, ImageTracks)), None)
        outputs.append(FrameOutput(message, tracks, boxes))
    return outputs
