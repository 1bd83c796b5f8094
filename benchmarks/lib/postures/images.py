"""Real images as video with the noise of a sensor: figures that never move, and posters.

An image that is repeated is a figure that never moves; a poster has the depth of a plane. The
noise of a Kinect is 1.4 mm at 1 m and grows with the squared distance; colours have 3 of 255 grey
levels.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import cv2
import msgspec
import numpy as np

from benchmarks.lib.marks.crossing import crossing_camera
from benchmarks.lib.marks.recording import detect_all, read_images
from benchmarks.lib.marks.stills import FELIX_HZ, KINECT, UNMASKED, felix, uc3m
from benchmarks.lib.postures.objects import SHORT_S, Figure, figure, row
from evaluation.methods import Method, read_methods
from evaluation.recordings.detections import read_tracker_input
from people4d.messages import Detections, Message, Skeletons, Tracks
from services.camera.config import CameraConfig
from services.camera.source import SourceFrame
from services.skeleton.build import build as build_skeleton
from services.skeleton.config import SkeletonConfig
from services.tracker.build import build as build_tracker

ROBOT = "empty_lab"  # laboratory without people, with a humanoid robot
STANDING = ("alberto2", "alvaro1", "height02", "height04", "height05", "juggling2")
FRAMES = 20  # number of frames with their own noise, which repeat
NOISE_PER_M, GREY_SIGMA = 1.4e-3, 3.0  # noise of depth [1/m] and of colour
# Distance of each plane [m], and its slope across the view
PLANES = ((2.2, 0.2), (2.6, 0.0), (3.0, 0.3), (3.0, -0.4), (3.4, 0.1), (3.8, 0.0))


def image_rows(shared: Path, cache: Path) -> Iterator[list[str]]:
    """Yield rows for objects and people in real images."""
    (method,), data = read_methods(["best"]), shared / "data" / "rgbd"
    stills, folder = uc3m(data, cache).camera, cache / "objects"
    listed = sorted((data / "uc3m").glob("*_rgb.png"))
    names = [p.stem.removesuffix("_rgb") for p in listed if not p.stem.startswith(UNMASKED)]
    images = dict(zip(names, read_images(stills)[1], strict=True))
    screen = [_flat(one, 3.0, 0.1) for one in read_images(crossing_camera(shared))[1]]

    def play(name: str, frames: Iterable[SourceFrame]) -> list[Figure]:
        return _play(method, _video(folder / name, frames), cache, SHORT_S)

    robot = play("robot", [images[ROBOT]] * FRAMES)
    yield row("robot of uc3m, one image", robot)
    still = [one for name in STANDING for one in play(name, [images[name]] * FRAMES)]
    yield row("people of uc3m, one image each", still)
    posters = [
        one
        for name, (far_m, slope) in zip(STANDING, PLANES, strict=True)
        for one in play(f"poster_{name}", [_flat(images[name], far_m, slope)] * FRAMES)
    ]
    yield row("people of uc3m on posters", posters)
    yield row("filinha on a screen", _play(method, _video(folder / "screen", screen), cache))
    yield row("felix, a seated and a standing man", _play(method, felix(data).camera, cache))
    yield row("filinha, walking people", _play(method, crossing_camera(shared), cache))


def _flat(image: SourceFrame, far_m: float, slope: float) -> SourceFrame:
    """Return an image whose depth is a plane."""
    height, width = image.depth_mm.shape
    across = (np.arange(width) - width / 2) / width
    depth_mm = np.tile(1000 * far_m / (1 + slope * across), (height, 1))
    return SourceFrame(image.rgb, depth_mm.astype(np.uint16), image.stamp_ns)


def _video(folder: Path, frames: Iterable[SourceFrame]) -> CameraConfig:
    """Write frames with noise, and return their camera."""
    rng = np.random.default_rng(51)
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True, exist_ok=True)
    for number, frame in enumerate(frames):
        depth_m = frame.depth_mm / 1000.0
        noise_m = rng.normal(0.0, 1.0, depth_m.shape) * NOISE_PER_M * depth_m**2
        depth_mm = np.where(depth_m > 0, 1000 * (depth_m + noise_m), 0).clip(0, 65535)
        rgb = (frame.rgb + rng.normal(0.0, GREY_SIGMA, frame.rgb.shape)).clip(0, 255)
        cv2.imwrite(str(folder / f"rgb/{number:03d}.png"), rgb[..., ::-1].astype(np.uint8))
        cv2.imwrite(str(folder / f"depth/{number:03d}.png"), depth_mm.astype(np.uint16))
    (folder / "camera.toml").write_text(KINECT, encoding="utf-8")
    options = {"fps": FELIX_HZ}
    return CameraConfig(source=str(folder), options=options, playback="lockstep", window=1)


def _play(
    method: Method, camera: CameraConfig, cache: Path, duration_s: float = 0.0
) -> list[Figure]:
    """Return the figure of each track, with the frames repeated for a duration."""
    files = detect_all(method, camera, cache)
    return play_messages(method, list(read_tracker_input(files.detections, None)), duration_s)


def play_messages(
    method: Method, messages: Sequence[Message], duration_s: float = 0.0
) -> list[Figure]:
    """Return the figure of each track, with the detections repeated for a duration."""
    config = msgspec.structs.replace(method.tracker, embedding_wait_s=0.0, reorder_wait_s=0.0)
    tracker, skeleton = build_tracker(config), build_skeleton(SkeletonConfig())
    frames = [one for one in messages if isinstance(one, Detections)]
    for message in messages:
        if not isinstance(message, Detections):
            tracker.handle(message, 0)
            skeleton.handle(message, 0)
    likes = defaultdict[int, list[tuple[float, float]]](list)
    for number, frame in enumerate(_repeated(frames, duration_s)):
        skeleton.handle(frame, 0)
        for tracks in tracker.handle(frame, 0):
            found = skeleton.handle(tracks, 0) if isinstance(tracks, Tracks) else ()
            for skeletons in found:
                assert isinstance(skeletons, Skeletons)
                for person in skeletons.people:
                    likes[person.id].append((number / FELIX_HZ, person.object_like))
    return [figure(*zip(*pairs, strict=True)) for pairs in likes.values()]


def _repeated(frames: Sequence[Detections], duration_s: float) -> Iterator[Detections]:
    """Yield frames in a loop for a duration, at least once each, with rising stamps."""
    step_ns = frames[1].stamp_ns - frames[0].stamp_ns
    for number in range(max(len(frames), round(duration_s * 1e9 / step_ns))):
        stamp_ns = frames[0].stamp_ns + number * step_ns
        frame = frames[number % len(frames)]
        yield msgspec.structs.replace(frame, stamp_ns=stamp_ns, sequence=number)
