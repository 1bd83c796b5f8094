"""Augmentations of a recording: mirrored, dark, blurred, in another light or order."""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import msgspec
import numpy as np

from benchmarks.lib.marks.recording import FrameOutput, MarkedRecording
from benchmarks.lib.marks.scores import MarkTruth
from evaluation.annotations.marks import MarkView
from evaluation.methods import Method
from people4d.messages import (
    F64,
    U8,
    U16,
    CameraInfo,
    Crops,
    Detections,
    Embeddings,
    RgbdFrame,
    StaticTransform,
    Tracks,
)
from services.camera.source import SourceFrame
from services.detector.build import build as build_detector
from services.detector.models.base import DetectedPerson, PersonModel
from services.detector.models.registry import load_model
from services.reid.build import build as build_reid
from services.tracker.build import build as build_tracker

CAMERA = "camera"
OPTICAL = "camera_optical"
STEP_NS = 100_000_000  # [ns] interval of frames
BLOCK_PX = 8  # [px] side of a hole in the depth of a blurred image
LOST_BLOCKS = 0.1  # share of blocks without depth

Cache = dict[bytes, list[DetectedPerson]]  # output of one network, by digest of the image
Images = Callable[[U8, U16, np.random.Generator], tuple[U8, U16]]
Order = Callable[[int], range]  # order of frames, given their number


def unchanged(rgb: U8, depth_mm: U16, _rng: np.random.Generator) -> tuple[U8, U16]:
    """Return the images unchanged."""
    return rgb, depth_mm


def dark(rgb: U8, depth_mm: U16, rng: np.random.Generator) -> tuple[U8, U16]:
    """Return a darker image with noise."""
    noisy = 255.0 * (rgb / 255.0) ** 1.8 + rng.normal(0.0, 5.0, rgb.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8), depth_mm


def blurred(rgb: U8, depth_mm: U16, rng: np.random.Generator) -> tuple[U8, U16]:
    """Return an image of half the resolution, and depth with holes."""
    height, width = depth_mm.shape
    half = cv2.resize(rgb, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    lost = rng.random((height // BLOCK_PX + 1, width // BLOCK_PX + 1)) < LOST_BLOCKS
    lost = lost.repeat(BLOCK_PX, axis=0).repeat(BLOCK_PX, axis=1)[:height, :width]
    rgb = np.asarray(cv2.resize(half, (width, height)), np.uint8)
    return rgb, np.where(lost, 0, depth_mm).astype(np.uint16)


def warm(rgb: U8, depth_mm: U16, _rng: np.random.Generator) -> tuple[U8, U16]:
    """Return a brighter image in warmer light."""
    return np.clip(rgb * np.array([1.25, 1.1, 0.95]) + 10, 0, 255).astype(np.uint8), depth_mm


@dataclass(frozen=True)
class ImageVariation:
    """Augmentation of the images of a recording."""

    name: str
    change: Images = unchanged
    mirrored: bool = False


@dataclass(frozen=True)
class OrderVariation:
    """Frames in another order."""

    name: str
    frames: Order
    reversed: bool = False  # True: people walk backwards, their yaw is not scored


IMAGES = (
    ImageVariation("as recorded"),
    ImageVariation("mirrored", mirrored=True),
    ImageVariation("dark, noisy", dark),
    ImageVariation("blurred, depth with holes", blurred),
    ImageVariation("mirrored, warm and bright", warm, mirrored=True),
)
ORDERS = (
    OrderVariation("all frames", range),
    OrderVariation("even frames", lambda n: range(0, n, 2)),
    OrderVariation("odd frames", lambda n: range(1, n, 2)),
    OrderVariation("from frame 20", lambda n: range(20, n)),
    OrderVariation("from frame 40", lambda n: range(40, n)),
    OrderVariation("backwards", lambda n: range(n - 1, -1, -1), reversed=True),
    OrderVariation("odd frames backwards", lambda n: range(n - 1 - n % 2, 0, -2), reversed=True),
)


def vary(recording: MarkedRecording, variation: ImageVariation) -> MarkedRecording:
    """Return the marks and the camera of augmented images."""
    view = recording.view
    if not variation.mirrored:
        return recording
    info = msgspec.structs.replace(view.info, cx=view.info.width - 1 - view.info.cx)
    turned = MarkView(info, mirrored_pose(view.map_from_optical))
    truth = {
        frame: tuple(_mirrored(one, turned) for one in people)
        for frame, people in recording.truth.items()
    }
    return replace(recording, view=turned, truth=truth)


def mirrored_pose(map_from_optical: F64) -> F64:
    """Return the pose (4x4) of a camera in a mirrored room."""
    return np.diag([1.0, -1.0, 1.0, 1.0]) @ map_from_optical @ np.diag([-1.0, 1.0, 1.0, 1.0])


def _mirrored(one: MarkTruth, view: MarkView) -> MarkTruth:
    yaw_deg, width = one.mark.yaw_deg, view.info.width
    mark = msgspec.structs.replace(
        one.mark, u_px=width - 1 - one.mark.u_px, yaw_deg=None if yaw_deg is None else -yaw_deg
    )
    point_m = None if one.point_m is None else one.point_m * (1.0, -1.0, 1.0)
    return MarkTruth(mark, point_m, view.yaw_rad(mark))


class CachingModel:
    """A model with a cache, which runs once on each image."""

    def __init__(self, model: PersonModel, cache: Cache) -> None:
        self.name, self._model, self._cache = model.name, model, cache

    def detect(self, rgb: U8) -> list[DetectedPerson]:
        """Find people, see `PersonModel.detect`."""
        key = hashlib.blake2b(np.ascontiguousarray(rgb).data, digest_size=8).digest()
        if key not in self._cache:
            self._cache[key] = self._model.detect(rgb)
        return list(self._cache[key])


@dataclass(frozen=True)
class VariedDetections:
    """Detections and embeddings of augmented images, by frame."""

    start: tuple[CameraInfo, StaticTransform]
    found: Sequence[Detections]
    embeddings: Sequence[Embeddings | None]


def detect(
    method: Method,
    view: MarkView,
    images: Sequence[SourceFrame],
    variation: ImageVariation,
    cache: Cache,
) -> VariedDetections:
    """Detect and embed people of augmented images; `cache` belongs to a model and its settings."""
    names = {"camera": CAMERA, "frame_id": OPTICAL, "stamp_ns": 0, "sequence": 0}
    info = msgspec.structs.replace(view.info, **names)
    link = StaticTransform(
        parent="map", child=OPTICAL, matrix=view.map_from_optical, stamp_ns=0, sequence=0
    )
    frames, rng = list[RgbdFrame](), np.random.default_rng(1)
    for number, image in enumerate(images):
        rgb, depth_mm = image.rgb, image.depth_mm
        if variation.mirrored:
            rgb, depth_mm = rgb[:, ::-1], depth_mm[:, ::-1]
        rgb, depth_mm = variation.change(rgb, depth_mm, rng)
        frames.append(
            RgbdFrame(
                camera=CAMERA,
                rgb=np.ascontiguousarray(rgb),
                depth_mm=np.ascontiguousarray(depth_mm),
                lockstep=True,
                sequence=number,
                stamp_ns=(number + 1) * STEP_NS,
            )
        )
    model = CachingModel(load_model(method.detector), cache)
    detector = build_detector(method.detector, model)
    list(detector.handle(info, 0))
    embedder = build_reid(method.reid) if method.reid else None
    found, embeddings = list[Detections](), list[Embeddings | None]()
    for frame in frames:
        messages = list(detector.handle(frame, 0))
        found += [m for m in messages if isinstance(m, Detections)]
        crops = [m for m in messages if isinstance(m, Crops)] if embedder else []
        vectors = [m for one in crops for m in embedder.handle(one, 0)] if embedder else []
        embeddings.append(next((m for m in vectors if isinstance(m, Embeddings)), None))
    return VariedDetections((info, link), found, embeddings)


def track(
    method: Method, detections: VariedDetections, order: OrderVariation
) -> Iterator[tuple[int, FrameOutput]]:
    """Yield the number and the tracks of each frame, in a playback order."""
    config = msgspec.structs.replace(method.tracker, embedding_wait_s=0.0, reorder_wait_s=0.0)
    node, frames = build_tracker(config), order.frames(len(detections.embeddings))
    for message in detections.start:
        list(node.handle(message, 0))
    for count, frame in enumerate(frames, 1):
        stamp_ns = count * abs(frames.step) * STEP_NS
        found, embeddings = detections.found[frame], detections.embeddings[frame]
        found = msgspec.structs.replace(found, stamp_ns=stamp_ns)
        if embeddings:
            list(node.handle(msgspec.structs.replace(embeddings, stamp_ns=stamp_ns), 0))
        tracks = next(m for m in node.handle(found, 0) if isinstance(m, Tracks))
        yield frame, FrameOutput(found, tracks, None)


def in_order(
    recording: MarkedRecording, outputs: Sequence[tuple[int, FrameOutput]]
) -> tuple[MarkedRecording, Mapping[int, int]]:
    """Return the marks by position in an order, and the frame of each position."""
    frames = {position: frame for position, (frame, _) in enumerate(outputs)}
    truth = {p: recording.truth[f] for p, f in frames.items() if f in recording.truth}
    return replace(recording, truth=truth), frames
