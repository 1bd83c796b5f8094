"""Annotated images of real people beside the long recording."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import numpy.typing as npt

from benchmarks.lib.marks.methods import MARKS
from benchmarks.lib.marks.recording import detect_all, marked
from benchmarks.lib.marks.scores import MarkScores, MarkTruth, TrackedPerson
from common.io.recording import open_recording
from evaluation.annotations.marks import Mark
from evaluation.methods import Method
from people4d.messages import Detections
from services.camera.config import CameraConfig

SINGLE_HZ = 0.1  # [Hz] rate of single images, which share nothing
FELIX_FRAMES, FELIX_HZ = 40, 10.0
# Default calibration of a Kinect, since the images have none
KINECT = "fx = 525.0\nfy = 525.0\ncx = 319.5\ncy = 239.5\n"
# Half of the calibration at 1920x1080
OUTDOORS = "fx = 696.225\nfy = 945.184\ncx = 472.219\ncy = 273.325\n"
TORSO_HEIGHT = 0.35  # height of the torso in a person's mask, as a share from the top
UNMASKED = "inside1"  # picture of a person without a mask
Image = npt.NDArray[Any]


class _MarkedFile(msgspec.Struct, frozen=True):
    file: str
    people: tuple[Mark, ...]


class _MarkFile(msgspec.Struct, frozen=True):
    marks: tuple[_MarkedFile, ...]


@dataclass(frozen=True)
class MarkedImages:
    """Images of one camera with their annotations by frame."""

    camera: CameraConfig
    marks: dict[int, tuple[Mark, ...]]


def tue(data: Path) -> Iterator[MarkedImages]:
    """Yield five bags of one frame each: one man in front, most people behind a desk."""
    for file, people in _by_file().items():
        if file.startswith("tue/"):
            yield MarkedImages(_camera(data / file), {0: people})


def felix(data: Path) -> MarkedImages:
    """Return a sequence of a man who sits and points, and stands beside himself."""
    calibration = str(data / "felix" / "cam_params_realsense.json")
    camera = _camera(data / "felix", calibration=calibration, fps=FELIX_HZ)
    return MarkedImages(camera, dict.fromkeys(range(FELIX_FRAMES), _by_file()["felix"]))


def outdoors(data: Path, scratch: Path) -> MarkedImages:
    """Return one frame in sunlight, with depth at a tenth of the pixels."""
    depth_mm = _read(data / "outdoors" / "depth.png")
    height, width = depth_mm.shape
    halved = depth_mm.reshape(height // 2, 2, width // 2, 2).max(axis=(1, 3))
    folder = scratch / "outdoors"
    _write(folder, "0", _read(data / "outdoors" / "color.png"), halved, OUTDOORS)
    return MarkedImages(_camera(folder, fps=SINGLE_HZ), {0: _by_file()["outdoors"]})


def uc3m(data: Path, scratch: Path) -> MarkedImages:
    """Return single images of one or two people, with points from masks checked by hand."""
    folder, marks = scratch / "uc3m", dict[int, tuple[Mark, ...]]()
    images = sorted((data / "uc3m").glob("*_rgb.png"))
    for number, path in enumerate(p for p in images if not p.stem.startswith(UNMASKED)):
        stem = str(path).removesuffix("_rgb.png")
        text = Path(f"{stem}_depth_params.yaml").read_text(encoding="utf-8")
        alpha, beta = (
            float(text.partition(f"{name}: ")[2].split()[0]) for name in ("alpha", "beta")
        )
        values = _read(f"{stem}_depth.png").astype(np.float64)
        depth_mm = np.where(values > 0, 1000 * (values - beta) / alpha, 0).astype(np.uint16)
        _write(folder, str(number), _read(path), depth_mm, KINECT)
        mask = _read(f"{stem}_user_mask.png")
        mask = mask if mask.ndim == 2 else mask.max(axis=2)
        marks[number] = tuple(
            _torso(f"{path.stem} {person}", mask == person) for person in np.unique(mask[mask > 0])
        )
    return MarkedImages(_camera(folder, fps=SINGLE_HZ), marks)


def still_scores(method: Method, sets: Sequence[MarkedImages], cache: Path) -> MarkScores:
    """Return the scores of detections in single images of several cameras."""
    truth, found = dict[int, tuple[MarkTruth, ...]](), dict[int, list[TrackedPerson]]()
    for number, one in enumerate(sets):
        recording, _ = marked(one.camera, one.marks)
        files = detect_all(method, one.camera, cache)
        messages = open_recording(files.detections).messages(Detections)
        detected = recording.detected(m for _, m in messages if isinstance(m, Detections))
        for frame, people in recording.truth.items():
            key = len(truth)
            # Identities hold within one image.
            truth[key] = tuple(_renamed(person, f"{number} {frame}") for person in people)
            found[key] = detected[frame]
    return MarkScores(truth, found, SINGLE_HZ)


def _renamed(one: MarkTruth, image: str) -> MarkTruth:
    mark = msgspec.structs.replace(one.mark, person=f"{image} {one.mark.person}")
    return MarkTruth(mark, one.point_m, one.yaw_rad)


def _torso(person: str, mask: Image) -> Mark:
    """Return a point on the torso of a person's mask."""
    rows = np.flatnonzero(mask.any(axis=1))
    row = round(rows[0] + TORSO_HEIGHT * (rows[-1] - rows[0]))
    return Mark(person, float(np.median(np.flatnonzero(mask[row]))), float(row), None)


def _by_file() -> dict[str, tuple[Mark, ...]]:
    content = msgspec.json.decode((MARKS / "stills.json").read_bytes(), type=_MarkFile)
    return {one.file: one.people for one in content.marks}


def _camera(source: Path, **settings: object) -> CameraConfig:
    return CameraConfig(source=str(source), options=settings, playback="lockstep", window=1)


def _read(path: Path | str) -> Image:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise OSError(f"{path} is not a readable image")
    return np.asarray(image)


def _write(folder: Path, name: str, bgr: Image, depth_mm: Image, calibration: str) -> None:
    for kind, image in (("rgb", bgr), ("depth", depth_mm)):
        (folder / kind).mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / kind / f"{name}.png"), image)
    (folder / "camera.toml").write_text(calibration, encoding="utf-8")
