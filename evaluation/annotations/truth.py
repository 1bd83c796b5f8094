"""Ground truth from annotations: positions by depth, at the stamps of annotated frames."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from common.geometry.transform_buffer import TransformBuffer
from evaluation.annotations.marks import (
    Mark,
    MarkView,
    check_recording,
    digest_of,
    read_annotations,
)
from evaluation.recordings.ground_truth import SampledTruth, TruthFrame, sample_truth
from people4d.errors import SourceError
from people4d.messages import (
    F64,
    Message,
    MovingTransform,
    Odometry,
    StaticTransform,
    Truth,
    TruthPerson,
)
from services.camera.config import CameraConfig
from services.camera.source import SourceFrame
from services.camera.sources import open_source

# Visible share by occlusion; below ground_truth.VISIBLE_MIN a person need not be tracked
SHARES = {"no": 1.0, "partly": 0.7, "mostly": 0.2}
TRANSFORMS = (StaticTransform, MovingTransform, Odometry)


@dataclass(frozen=True)
class _AnnotatedFrame:
    truth: Truth
    marks: tuple[Mark, ...]
    map_from_camera: F64


def annotated_truth(
    path: Path,
    camera: CameraConfig,
    messages: Iterable[Message],
    stamps_ns: Sequence[int],
    frame_id: str,
) -> SampledTruth:
    """Return the truth at the stamps of frames; None at frames without annotations.

    A person without depth has a position if it follows from annotations within 2 s. SourceError if
    the file belongs to another recording, no frame of it is played, or no position is known.

    Args:
        path: File of annotations.
        camera: Source of the images.
        messages: Transforms from the camera to `frame_id`.
        stamps_ns: Stamps of the frames.
        frame_id: Frame of the positions.
    """
    buffer = TransformBuffer(history_s=1e9)
    for message in messages:
        if isinstance(message, TRANSFORMS):
            buffer.add_transform(message)
    frames = {f.truth.stamp_ns: f for f in _frames(path, camera, buffer, frame_id)}
    if not frames.keys() & set(stamps_ns):
        raise SourceError(
            f"{path} annotates no frame of {camera.source} that is played",
            "Annotate some, or play the whole recording.",
        )
    sampled = sample_truth([f.truth for f in frames.values()], stamps_ns, str(path))
    if not sampled.ids:
        raise SourceError(f"{path} has no annotation with depth", "Mark torsos that have depth.")
    played = zip(stamps_ns, sampled.frames, strict=True)
    annotated = tuple(
        _with_view(people, frames.get(stamp), sampled.ids) for stamp, people in played
    )
    return SampledTruth(frame_id, sampled.ids, annotated)


def _with_view(
    people: TruthFrame | None, frame: _AnnotatedFrame | None, ids: Sequence[str]
) -> TruthFrame | None:
    if people is None or frame is None:
        return None
    visible = {mark.person: SHARES[mark.hidden] for mark in frame.marks}
    shares = dict.fromkeys(ids, 0.0) | visible
    return TruthFrame(people.people, people.captured, shares, frame.map_from_camera)


def _frames(
    path: Path, camera: CameraConfig, buffer: TransformBuffer, frame_id: str
) -> Iterator[_AnnotatedFrame]:
    annotations = read_annotations(path)
    marks_of, source = annotations.frames, open_source(camera.source, camera.options)
    captures = (item for item in source if isinstance(item, SourceFrame))
    for number, capture in enumerate(captures):
        if number == 0:
            check_recording(path, annotations, digest_of(capture.rgb))
        if number not in marks_of:
            continue
        pose = buffer.lookup(frame_id, source.info.frame_id, capture.stamp_ns)
        if pose is None:
            raise SourceError(
                f"{camera.source}: no transform from {source.info.frame_id} to {frame_id}",
                "Set camera.mount_xyz_m and camera.mount_rpy_rad, or record the transform.",
            )
        view = MarkView(source.info, pose.matrix)
        people = [
            TruthPerson(id=mark.person, position_m=position_m, yaw_rad=view.yaw_rad(mark))
            for mark in marks_of[number]
            if (position_m := view.axis_m(mark, capture.depth_mm)) is not None
        ]
        truth = Truth(
            stamp_ns=capture.stamp_ns, sequence=number, frame_id=frame_id, people=tuple(people)
        )
        yield _AnnotatedFrame(truth, marks_of[number], pose.matrix)
    source.close()
