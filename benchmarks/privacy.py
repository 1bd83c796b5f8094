"""Heads that `people4d anonymise` covers, against the ground truth of the lab.

    python -m benchmarks.privacy [--shared FOLDER] [--scenes NAME ...]

A head is to be covered in every frame in which a keypoint of its face (nose, eyes, ears) is
visible; it is covered if each visible one lies in a black rectangle. FOLDER is
the reference data; scenes are drawn.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from benchmarks.lib.lab_frames import lab_frames
from benchmarks.lib.table import markdown, write
from common.io.images import decode_jpeg
from common.io.recording import open_recording
from deploy.anonymise.heads import Cover, cover_frames
from deploy.anonymise.recordings import detect, model
from lab.catalogue import load_scenario
from lab.truth.frames import person_views
from lab.world import World
from people4d.messages import F64, U8, CompressedRgbdFrame
from services.detector.models.base import PersonModel

HEADER = ("recording", "frames", "heads", "covered", "by detections alone", "image blacked out")
FACE = slice(0, 5)
ROOT = Path(__file__).resolve().parents[1]
REFERENCE = ("two", "robot")  # recordings of the lab in the reference data
DEMO = ROOT / "deploy/demo/crossing.mcap"
NOTE = (
    "Heads: one for each person and frame with a visible keypoint of the face, nose, eyes or ears; "
    "covered: each visible keypoint of the face lies in a black rectangle. By detections alone: "
    "without the covers that are interpolated and held in time. The margins were set before the "
    "first of these runs and not changed since. Simulated people alone: no recording of real ones "
    "has marks of every face."
)


@dataclass
class _Result:
    covers: list[list[Cover]] = field(default_factory=list)
    times_s: list[float] = field(default_factory=list)
    faces: list[list[F64]] = field(default_factory=list)  # visible keypoints of each head
    size: tuple[int, int] = (0, 0)


def folder_frames(folder: Path) -> Iterator[tuple[U8, float, list[F64]]]:
    """Yield images, times and visible keypoints of faces of a folder with gt.npz."""
    truth = np.load(folder / "gt.npz")
    for path, time_s, points, visible in zip(
        sorted((folder / "rgb").iterdir()), truth["t"], truth["kp2d"], truth["kpvis"], strict=True
    ):
        image = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB)
        assert image is not None, path
        yield np.asarray(image, np.uint8), float(time_s), _faces(points, visible)


def shipped_frames() -> Iterator[tuple[U8, float, list[F64]]]:
    """Yield the same of the shipped recording; people alone hide people in its truth."""
    recording, world = open_recording(DEMO), World(load_scenario("crossing"))
    frames = (m for _, m in recording.messages(CompressedRgbdFrame))
    for index, frame in enumerate(frames):
        assert isinstance(frame, CompressedRgbdFrame)
        people = person_views(world, world.frame_s(index), None)
        points = np.array([p.keypoints_px for p in people])
        visible = np.array([p.visible for p in people])
        yield decode_jpeg(frame.rgb_jpeg), world.frame_s(index), _faces(points, visible)


def scene_frames(name: str, count: int, seed: int) -> Iterator[tuple[U8, float, list[F64]]]:
    """Yield the same of a scene of the lab."""
    for frame in lab_frames(name, count, seed):
        points = np.array([p.keypoints_px for p in frame.people])
        visible = np.array([p.visible for p in frame.people])
        yield frame.rgb, frame.time_s, _faces(points, visible)


def _faces(points: F64, visible: U8) -> list[F64]:
    return [p[FACE][v[FACE] > 0] for p, v in zip(points, visible, strict=True) if v[FACE].any()]


def measure(frames: Iterator[tuple[U8, float, list[F64]]], network: PersonModel) -> _Result:
    """Detect the people of all frames."""
    result = _Result()
    for rgb, time_s, faces in frames:
        result.covers.append(detect(rgb, network))
        result.times_s.append(time_s)
        result.faces.append(faces)
        result.size = rgb.shape[1], rgb.shape[0]
    return result


def row(name: str, result: _Result) -> list[str]:
    """Return a line of the table."""
    rectangles = cover_frames(result.covers, result.times_s)
    alone = [[cover.head_xyxy_px for cover in covers] for covers in result.covers]
    heads = sum(map(len, result.faces))
    area = np.mean([_share(found, result.size) for found in rectangles])
    cells = [f"{_covered(result.faces, boxes) / heads:.2%}" for boxes in (rectangles, alone)]
    return [name, str(len(result.faces)), str(heads), *cells, f"{area:.1%}"]


def _covered(faces: Sequence[list[F64]], rectangles: Sequence[list[F64]]) -> int:
    return sum(
        all(any(_inside(point, box) for box in boxes) for point in head)
        for heads, boxes in zip(faces, rectangles, strict=True)
        for head in heads
    )


def _inside(point: F64, box: F64) -> bool:
    return bool(np.all(point >= box[:2]) and np.all(point <= box[2:]))


def _share(rectangles: Sequence[F64], size: tuple[int, int]) -> float:
    mask = np.zeros((size[1], size[0]), np.uint8)
    for left, top, right, bottom in rectangles:
        corners = (int(max(left, 0)), int(max(top, 0))), (int(max(right, 0)), int(max(bottom, 0)))
        cv2.rectangle(mask, *corners, 1, cv2.FILLED)
    return float(mask.mean())


def main() -> None:
    """Detect, cover, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--shared", type=Path, default=ROOT.parent / "shared")
    parser.add_argument("--scenes", nargs="*", default=[])
    parser.add_argument("--frames", type=int, default=60, help="of each scene")
    parser.add_argument("--seed", type=int, default=901)
    asked = parser.parse_args()
    network = model()
    lines = []
    lines.append(row(f"`{DEMO.name}`, shipped", measure(shipped_frames(), network)))
    print(*lines[-1], sep=" | ", flush=True)
    for folder in (asked.shared / "data/lab" / name for name in REFERENCE):
        lines.append(row(f"`lab/{folder.name}`", measure(folder_frames(folder), network)))
        print(*lines[-1], sep=" | ", flush=True)
    for name in asked.scenes:
        frames = scene_frames(name, asked.frames, asked.seed)
        lines.append(row(f"`lab:{name}`", measure(frames, network)))
        print(*lines[-1], sep=" | ", flush=True)
    write(__file__, "Heads covered by `people4d anonymise`", NOTE, markdown(HEADER, lines))


if __name__ == "__main__":
    main()
