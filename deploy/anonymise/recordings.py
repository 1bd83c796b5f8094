"""Anonymised copies of recordings."""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from common.io.images import decode_jpeg, encode_jpeg
from common.io.recording import Recording, RecordingWriter, open_recording
from deploy.anonymise.colourless import LEFT_OUT, grey_frame
from deploy.anonymise.heads import Cover, cover_frames, cover_of
from people4d.errors import DecodeError
from people4d.messages import F64, U8, CompressedRgbdFrame, Detections
from services.detector.config import ModelSettings
from services.detector.models.base import PersonModel
from services.detector.models.registry import load_model

# Minimum score, below the detector's threshold: a false cover costs less than a visible face
SCORE_MIN = 0.02
PEOPLE_MAX = 30
QUALITY = 90  # JPEG quality
OnProgress = Callable[[float], object]


@dataclass
class AnonymisedCounts:
    """Numbers of written frames and covers, and of omitted messages."""

    frames: int = 0  # number of written frames
    covers: int = 0  # number of blacked out rectangles
    bad_images: int = 0  # number of frames omitted since they could not be decoded
    left_out: int = 0  # number of omitted crops and embeddings


def model() -> PersonModel:
    """Return the detection model with a low minimum score."""
    return load_model(ModelSettings(score_min=SCORE_MIN, max_people=PEOPLE_MAX))


def detect(rgb: U8, network: PersonModel) -> list[Cover]:
    """Return the covers of the people in an image, HxWx3.

    The model runs on the whole image and on two overlapping parts, which raise the recall of small
    and cut-off people.
    """
    found = [cover_of(p.box_xyxy_px, p.keypoints) for p in network.detect(rgb)]
    width = rgb.shape[1]
    for left in (0, width - width * 5 // 8):
        part = np.ascontiguousarray(rgb[:, left : left + width * 5 // 8])
        for person in network.detect(part):
            box, keypoints = person.box_xyxy_px.copy(), person.keypoints
            box[[0, 2]] += left
            if keypoints is not None:
                keypoints = keypoints.copy()
                keypoints[:, 0] += left
            found.append(cover_of(box, keypoints))
    return found


def black_out(rgb: U8, rectangles: list[F64]) -> U8:
    """Return a copy of an image with black rectangles (4, xyxy)."""
    covered = rgb.copy()
    height, width = rgb.shape[:2]
    for left, top, right, bottom in rectangles:
        rows = slice(max(int(np.floor(top)), 0), max(min(int(np.ceil(bottom)), height), 0))
        columns = slice(max(int(np.floor(left)), 0), max(min(int(np.ceil(right)), width), 0))
        covered[rows, columns] = 0
    return covered


def anonymise(
    source: Path, target: Path, colour: bool, on_progress: OnProgress
) -> AnonymisedCounts:
    """Write a copy of a recording with black heads, or without colour.

    Depth is unchanged. Crops and embeddings are omitted. SourceError if a file cannot be read or
    written.

    Args:
        source: Recording to copy.
        target: The recording to write.
        colour: False: grey images in place of colour.
        on_progress: Called with the progress, 0 to 1.
    """
    recording, counts = open_recording(source), AnonymisedCounts()
    covers = cover_recording(recording, model(), on_progress) if colour else {}
    with RecordingWriter(target) as writer:
        for name, values in recording.metadata.items():
            writer.write_metadata(name, values)
        for log_time_ns, message in recording.messages():
            if isinstance(message, LEFT_OUT):
                counts.left_out += 1
            elif isinstance(message, CompressedRgbdFrame):
                rectangles = covers.get((message.camera, message.stamp_ns), [])
                try:
                    frame = _covered(message, rectangles) if colour else grey_frame(message)
                except DecodeError:
                    counts.bad_images += 1
                    continue
                writer.write(frame, log_time_ns)
                counts.frames += 1
                counts.covers += len(rectangles)
            else:
                writer.write(message, log_time_ns)
    return counts


def cover_recording(
    recording: Recording, network: PersonModel, on_progress: OnProgress
) -> dict[tuple[str, int], list[F64]]:
    """Return the rectangles to black out by camera and stamp, also by recorded detections."""
    known: dict[tuple[str, int], list[Cover]] = {}
    for _, message in recording.messages(Detections):
        if isinstance(message, Detections):
            covers = [cover_of(d.box_xyxy_px, d.keypoints) for d in message.detections]
            known[message.camera, message.stamp_ns] = covers
    stamps_ns, detected = (
        defaultdict[str, list[int]](list),
        defaultdict[str, list[list[Cover]]](list),
    )
    total = max(sum(n for t, n in recording.summary.topics.items() if t.endswith("compressed")), 1)
    for k, (_, frame) in enumerate(recording.messages(CompressedRgbdFrame)):
        assert isinstance(frame, CompressedRgbdFrame)
        try:
            found = detect(decode_jpeg(frame.rgb_jpeg), network)
        except DecodeError:
            continue
        stamps_ns[frame.camera].append(frame.stamp_ns)
        detected[frame.camera].append(found + known.get((frame.camera, frame.stamp_ns), []))
        on_progress((k + 1) / total)
    rectangles: dict[tuple[str, int], list[F64]] = {}
    for camera, times_ns in stamps_ns.items():
        times_s = [(time_ns - times_ns[0]) / 1e9 for time_ns in times_ns]
        covered = cover_frames(detected[camera], times_s)
        rectangles |= {(camera, t): found for t, found in zip(times_ns, covered, strict=True)}
    return rectangles


def _covered(frame: CompressedRgbdFrame, rectangles: list[F64]) -> CompressedRgbdFrame:
    covered = encode_jpeg(black_out(decode_jpeg(frame.rgb_jpeg), rectangles), QUALITY)
    return msgspec.structs.replace(frame, rgb_jpeg=covered)
