"""Postures of real people in the recordings of `benchmarks/real_people_marks`."""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.lib.marks.crossing import crossing_camera
from benchmarks.lib.marks.recording import detect_all, marked
from benchmarks.lib.marks.stills import MarkedImages, felix, tue, uc3m
from common.geometry.transforms import apply
from evaluation.annotations.marks import Mark
from evaluation.methods import Method, read_methods
from evaluation.recordings.detections import read_tracker_input
from people4d.messages import F64, Detection, Detections, Event, Skeletons, Tracks
from people4d.messages.skeleton import POSTURES
from services.camera.config import CameraConfig
from services.events.build import build as build_events
from services.events.config import EventsConfig
from services.skeleton.build import build as build_skeleton
from services.skeleton.config import SkeletonConfig
from services.skeleton.observation import JointObservation, observe_joints
from services.skeleton.posture import CORRELATION_S, PostureFilter
from services.skeleton.skeletons import People
from services.tracker.build import build as build_tracker

HEADER = ("recording", "people", "observations", *POSTURES, "no posture", "falls")
# Postures in images of uc3m, annotated by eye; other images are between two postures
STILLS = {
    "standing": "alberto1 alberto2 alvaro1 height01 height02 height03 height04 height05 juggling1 "
    "juggling2 juggling3",
    "bending": "height06 height07",
}


def real_rows(shared: Path, cache: Path) -> Iterator[list[str]]:
    """Yield a row for the people of each recording."""
    (method,), data = read_methods(["best"]), shared / "data" / "rgbd"
    images = felix(data)
    people = {mark.person: mark for mark in images.marks[0]}
    for name, found, falls in _play(method, images.camera, cache, people):
        yield _row("felix", name, found, falls)
    for name, found, falls in _play(method, crossing_camera(shared), cache, {}):
        yield _row("filinha", name, found, falls)
    stills = uc3m(data, cache)
    for posture, names in STILLS.items():
        chosen = [f"{name}_rgb " for name in names.split()]
        found = _stills(method, [stills], cache, chosen)
        yield _row("uc3m, single images", posture, found, None)
    found = _stills(method, list(tue(data)), cache, [""])
    yield _row("TUE, single images", "standing or hidden by a desk", found, None)


def _row(recording: str, people: str, found: Counter[str], falls: int | None) -> list[str]:
    names = (*POSTURES, "no posture")
    counts = [str(found[name]) for name in names]
    return [recording, people, str(found.total()), *counts, "-" if falls is None else str(falls)]


def _play(
    method: Method, camera: CameraConfig, cache: Path, people: dict[str, Mark]
) -> Iterator[tuple[str, Counter[str], int]]:
    """Yield people, the postures of their tracks in all frames, and all falls.

    Args:
        method: Method of detections and tracks.
        camera: Recording.
        cache: Folder of detections.
        people: Annotations that hold in all frames; none: all tracks are one row.
    """
    files = detect_all(method, camera, cache)
    config = msgspec.structs.replace(method.tracker, embedding_wait_s=0.0, reorder_wait_s=0.0)
    tracker, skeleton = build_tracker(config), build_skeleton(SkeletonConfig())
    events, falls = build_events(EventsConfig()), 0
    found = {name: Counter[str]() for name in people or ("all tracks",)}
    for message in read_tracker_input(files.detections, next(iter(files.embeddings), None)):
        skeleton.handle(message, 0)
        for tracks in tracker.handle(message, 0):
            if not isinstance(tracks, Tracks) or not isinstance(message, Detections):
                continue
            events.handle(tracks, 0)
            for skeletons in skeleton.handle(tracks, 0):
                reported = events.handle(skeletons, 0)
                falls += sum(isinstance(one, Event) and one.kind == "fell" for one in reported)
                for name, counts in found.items():
                    counts.update(_postures(skeletons, tracks, message, people.get(name)))
    for name, counts in found.items():
        yield name, counts, falls


def _postures(
    skeletons: object, tracks: Tracks, detections: Detections, mark: Mark | None
) -> Iterator[str]:
    """Yield the postures of tracks; of the track at an annotation, if one is given."""
    assert isinstance(skeletons, Skeletons)
    postures = {one.id: one.posture for one in skeletons.people}
    for track in tracks.tracks:
        detection = detections.at(track.detection)
        if mark is None and track.state == "confirmed":
            yield postures.get(track.id, "no posture")
        elif mark is not None and detection is not None and _holds(detection, mark):
            yield postures.get(track.id, "no posture")
            return
    if mark is not None:
        yield "no posture"


def _stills(
    method: Method, sets: Sequence[MarkedImages], cache: Path, names: Sequence[str]
) -> Counter[str]:
    """Return the postures of annotated people by single images, `names` begin their names."""
    found = Counter[str]()
    for images in sets:
        recording, _ = marked(images.camera, images.marks)
        view, files = recording.view, detect_all(method, images.camera, cache)
        messages = read_tracker_input(files.detections, None)
        frames = [one for one in messages if isinstance(one, Detections)]
        for frame, marks in images.marks.items():
            for mark in marks:
                if not mark.person.startswith(tuple(names)):
                    continue
                detected = [one for one in frames[frame].detections if _holds(one, mark)]
                if not detected or detected[0].position_m is None:
                    found["no posture"] += 1
                    continue
                position_m = apply(view.map_from_optical, detected[0].position_m)
                joints = observe_joints(detected[:1], view.info, view.map_from_optical)
                found[_single(np.asarray(position_m), joints)] += 1
    return found


def _single(position_m: F64, joints: JointObservation) -> str:
    """Return the posture of a person in one image."""
    person = People(
        ids=[1],
        position_m=position_m[None],
        velocity_mps=np.zeros((1, 3)),
        covariance_m2=np.zeros((1, 3, 3)),
        yaw_rad=np.full(1, np.nan),
    )
    ((posture, _),), _ = PostureFilter().update(CORRELATION_S, person, joints)
    return posture


def _holds(detection: Detection, mark: Mark) -> bool:
    left, top, right, bottom = detection.box_xyxy_px.tolist()
    return bool(left <= mark.u_px <= right and top <= mark.v_px <= bottom)
