"""Valid but unusual messages, as from a broken camera or another vendor's node."""

import itertools
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np

from people4d.messages import (
    CameraInfo,
    Crop,
    Detection,
    Detections,
    Mask,
    Message,
    RgbdFrame,
    Track,
    TruthPerson,
)
from people4d.messages.base import MAX_STAMP_NS
from tests.contract.examples import BY_NAME, DETECTION, FULL, KEYPOINTS, RGB, TRACK

FAR = 9e6  # [m] coordinate just within the limit
LAST_NS = MAX_STAMP_NS


def like(name: str, **fields: Any) -> Message:
    """Return the example of a message with other fields."""
    return msgspec.structs.replace(BY_NAME[name], **fields)


def infos() -> Iterator[CameraInfo]:
    """Calibrations: an image of one pixel, no view, an absurd lens, another frame's name."""
    base = BY_NAME["CameraInfo"]
    assert isinstance(base, CameraInfo)
    yield base
    plain = msgspec.structs.replace(base, distortion_model="none", distortion=())
    yield msgspec.structs.replace(plain, width=1, height=1, cx=-1e6, cy=1e6)
    yield msgspec.structs.replace(plain, fx=1.0, fy=1e5)
    yield msgspec.structs.replace(base, distortion=(1e4, -1e4, 1e4, -1e4))
    yield msgspec.structs.replace(plain, width=64, height=48, frame_id="other", max_depth_m=1e-9)
    yield msgspec.structs.replace(plain, width=64, height=48, fx=60.0, fy=60.0, cx=32.0, cy=24.0)


def frames() -> Iterator[RgbdFrame]:
    """Frames: another size than calibrated, no depth at all, depth at its limit."""
    for height, width in ((1, 1), (48, 64), (3, 90), (90, 3), (480, 640)):
        for depth in (0, 1, 65535):
            yield RgbdFrame(
                stamp_ns=0,
                sequence=0,
                camera="front",
                rgb=np.full((height, width, 3), depth % 256, np.uint8),
                depth_mm=np.full((height, width), depth, np.uint16),
            )


def odd_detections() -> Iterator[Detection]:
    """Detections: boxes without area, inside out, far off; keypoints and masks off the image."""
    boxes = ([0, 0, 0, 0], [9, 9, -9, -9], [-1e6, -1e6, 1e6, 1e6], [3e5, 3e5, 1e6, 1e6])
    for box in boxes:
        yield Detection(box_xyxy_px=np.array(box, np.float32), score=0.0)
        yield msgspec.structs.replace(DETECTION, box_xyxy_px=np.array(box, np.float32), score=1.0)
    for position in ([0.0, 0.0, 0.0], [FAR, FAR, FAR], [0.0, 0.0, -3.0], [FAR, -FAR, FAR]):
        yield msgspec.structs.replace(DETECTION, position_m=np.array(position))
    for keypoints in (KEYPOINTS * 0, KEYPOINTS * 0 + np.float32(1e6), -KEYPOINTS):
        yield msgspec.structs.replace(DETECTION, keypoints=keypoints)
    mask = Mask(x_px=10**9, y_px=10**9, width=1, height=1, bits=b"\x80")
    yield msgspec.structs.replace(DETECTION, mask=mask)
    yield DETECTION


def detections() -> Iterator[Detections]:
    """Each odd detection alone, all together, hundreds, none, and of another camera."""
    base = BY_NAME["Detections"]
    assert isinstance(base, Detections)
    parts = tuple(odd_detections())
    for part in parts:
        yield msgspec.structs.replace(base, detections=(part,))
    for group in (parts, parts * 20, (DETECTION,) * 3, ()):
        yield msgspec.structs.replace(base, detections=group)
    yield msgspec.structs.replace(base, width=1, height=1)
    yield msgspec.structs.replace(base, camera="unknown", frame_id="nowhere")


def appearances() -> Iterator[Message]:
    """Crops of one pixel; vectors: zeros, other lengths, unknown or repeated detections."""
    shapes = ((1, 1, 3), (1, 500, 3), (500, 1, 3), (2, 3, 3))
    crops = [Crop(detection=i, rgb=np.zeros(shape, np.uint8)) for i, shape in enumerate(shapes)]
    crops.append(Crop(detection=9, rgb=RGB, mask=np.zeros((2, 3), np.uint8), keypoints=KEYPOINTS))
    crops.append(Crop(detection=9, rgb=RGB, keypoints=KEYPOINTS * 0 + np.float32(1e6)))
    for crop in crops:
        yield like("Crops", crops=(crop,))
    yield like("Crops", crops=tuple(crops))
    yield like("Crops", crops=())
    for indices, length in (((), 4), ((0,), 4), ((0,), 512), ((0, 0), 4), ((10**9,), 4), ((0,), 0)):
        for value in (0.0, 0.5, 1e3):
            vectors = np.full((len(indices), length), value, np.float32)
            yield like("Embeddings", model="m", detections=indices, vectors=vectors)


def others() -> Iterator[Message]:
    """Jumping odometry, far frames, impossible people."""
    for x_m in (0.0, FAR, -FAR):
        yield like("Odometry", frame_id="o", child_frame_id="b", x_m=x_m, y_m=x_m, theta_rad=99.0)
    far = np.eye(4)
    far[:3, 3] = FAR
    for parent, child in (
        ("map", "front_optical_frame"),
        ("front_optical_frame", "map"),
        ("a", "a"),
    ):
        yield like("StaticTransform", parent=parent, child=child, matrix=far)
        yield like("StaticTransform", parent=parent, child=child, matrix=np.eye(4))
        yield like("MovingTransform", parent=parent, child=child, matrix=far)
    yield like("Tracks", tracks=())
    wild: dict[str, Track] = {
        "far": msgspec.structs.replace(TRACK, position_m=np.full(3, FAR)),
        "fast": msgspec.structs.replace(TRACK, velocity_mps=np.full(3, FAR), yaw_rad=99.0),
        "negative covariance": msgspec.structs.replace(TRACK, covariance=-np.eye(6)),
        "lost": msgspec.structs.replace(TRACK, state="lost", detection=10**9, id=2**62),
    }
    for track in wild.values():
        yield like("Tracks", tracks=(track,))
    yield like("Tracks", tracks=(*wild.values(), *wild.values()), frame_id="odom")
    person = TruthPerson(id="", position_m=np.full(3, FAR), velocity_mps=np.zeros(3), yaw_rad=99.0)
    yield like("Truth", frame_id="map", people=(person, person))
    yield like("Truth", frame_id="nowhere", people=())
    yield like("Health", service="camera", instance="i", host="", pid=-1, state="stalled")
    yield from FULL


def in_order() -> Iterator[Message]:
    """Yield odd messages at plausible times, so that they get far into a node."""
    usual = BY_NAME["CameraInfo"]
    assert isinstance(usual, CameraInfo)
    clock_ns = itertools.count(1_000_000_000, 33_000_000)
    number = itertools.count()
    embeddings = itertools.cycle(appearances())

    def at(message: Message, stamp_ns: int) -> Message:
        return msgspec.structs.replace(message, stamp_ns=stamp_ns, sequence=next(number))

    for info in (*infos(), usual):
        yield at(info, next(clock_ns))
        for frame in frames():
            if frame.rgb.shape[:2] == (info.height, info.width):
                yield at(frame, next(clock_ns))
    for message in others():
        yield at(message, next(clock_ns))
    for transform in (BY_NAME["CameraInfo"], BY_NAME["StaticTransform"]):
        yield at(transform, next(clock_ns))
    for found in (*detections(), *detections()):
        stamp_ns = next(clock_ns)
        yield at(found, stamp_ns)
        for message in itertools.islice(embeddings, 3):
            yield at(message, stamp_ns)


def out_of_order() -> Iterator[Message]:
    """Yield odd messages at odd times, with repeated sequence numbers."""
    kinds = [*infos(), *others(), *frames(), *detections(), *appearances()]
    stamps = (1_000_000_000, 1_033_000_000, 1_033_000_000, 500_000_000, -1, LAST_NS, 1_066_000_000)
    for sequence, stamp_ns in enumerate(stamps):
        for message in kinds:
            # Big images cost time and are no odder at another time.
            if not (isinstance(message, RgbdFrame) and message.rgb.size > 10_000):
                yield msgspec.structs.replace(message, stamp_ns=stamp_ns, sequence=sequence)
