"""Files of the AI City Challenge's scenes: calibration, videos, depth maps and truth."""

import importlib
from collections.abc import Callable, Iterator, Mapping
from itertools import count
from pathlib import Path
from typing import Any, TypeVar

import cv2
import msgspec
import numpy as np

from common.geometry.transforms import invert
from common.io.files import read_bytes
from evaluation.datasets.dataset import Dataset
from people4d.errors import ConfigError
from people4d.messages import CameraInfo, Message, RgbdFrame, StaticTransform

T = TypeVar("T")

PERIOD_NS = 1_000_000_000 // 30
MAX_BYTES = 2**31  # maximum size of a truth file: the largest has 510 MB
MAX_DEPTH_M = 20.0  # [m] maximum depth of a detection
DEPTH = "distance_to_image_plane_{:05}.png"
Depths = Callable[[Path], Mapping[str, Any]]  # opens the depth images of a file, by name


class AiCitySensor(msgspec.Struct, frozen=True, rename="camel"):
    """Calibration of one camera; `camera_matrix` takes points of the world to pixels."""

    id: str
    intrinsic_matrix: list[list[float]]
    camera_matrix: list[list[float]]

    def messages(self, width: int, height: int) -> tuple[CameraInfo, StaticTransform]:
        """Return calibration and pose."""
        K, P = np.array(self.intrinsic_matrix), np.array(self.camera_matrix)
        camera_from_map = np.eye(4)
        camera_from_map[:3] = np.linalg.solve(K, P)
        camera_from_map[:3] /= np.linalg.norm(camera_from_map[2, :3])
        info = CameraInfo(
            stamp_ns=0,
            sequence=0,
            camera=self.id,
            frame_id=self.id,
            width=width,
            height=height,
            fx=K[0, 0],
            fy=K[1, 1],
            cx=K[0, 2],
            cy=K[1, 2],
            max_depth_m=MAX_DEPTH_M,
        )
        pose = invert(camera_from_map)
        return info, StaticTransform(
            stamp_ns=0, sequence=0, parent="map", child=self.id, matrix=pose
        )


class AiCityCalibration(msgspec.Struct, frozen=True):
    """calibration.json."""

    sensors: list[AiCitySensor]


class AiCityObject(msgspec.Struct, frozen=True):
    """One object of a frame in ground_truth.json."""

    kind: str = msgspec.field(name="object type")
    id: int = msgspec.field(name="object id")
    centre_m: list[float] = msgspec.field(name="3d location")
    size_m: list[float] = msgspec.field(name="3d bounding box scale")
    rotation_rad: list[float] = msgspec.field(name="3d bounding box rotation")


Truth = list[list[AiCityObject]]  # people of each frame


def open_hdf5(path: Path) -> Mapping[str, Any]:
    """Open an HDF5 file; ConfigError if h5py is not installed."""
    try:
        h5py = importlib.import_module("h5py")
    except ImportError as error:
        raise ConfigError("depth maps are HDF5", "Install the package h5py.") from error
    file: Mapping[str, Any] = h5py.File(path)
    return file


def read_truth(dataset: Dataset, folder: Path, frames: int) -> Truth | None:
    """Return the people of each frame, None if not published; SourceError if they do not fit."""
    path = folder / "ground_truth.json"
    if not path.exists():
        return None
    objects = read_json(dataset, path, dict[int, list[AiCityObject]])
    if max(objects, default=0) >= frames:
        got = f"frame {max(objects)}"
        raise dataset.mismatch(path, f"frames 0 to {frames - 1} as in the videos", got)
    return [[o for o in objects.get(k, []) if o.kind == "Person"] for k in range(frames)]


def read_frames(
    dataset: Dataset, depths: Depths, folder: Path, sensor: AiCitySensor
) -> Iterator[Message]:
    """Yield calibration, pose and all frames of one camera."""
    video = folder / "videos" / f"{sensor.id}.mp4"
    capture = cv2.VideoCapture(str(video))
    images = depths(folder / "depth_maps" / f"{sensor.id}.h5")
    for number in count():
        valid, bgr = capture.read()
        if not valid:
            break
        if number == 0:
            yield from sensor.messages(bgr.shape[1], bgr.shape[0])
        if DEPTH.format(number) not in images:
            raise dataset.mismatch(video, f"{DEPTH.format(number)} in its .h5 file", "none")
        yield RgbdFrame(
            stamp_ns=number * PERIOD_NS,
            sequence=number,
            camera=sensor.id,
            rgb=np.ascontiguousarray(bgr[..., ::-1]),
            depth_mm=np.asarray(images[DEPTH.format(number)], np.uint16),
            lockstep=True,
        )


def read_json(dataset: Dataset, path: Path, kind: type[T]) -> T:
    """Read a file of a known layout; SourceError if it cannot be read, or has another layout."""
    try:
        return msgspec.json.decode(read_bytes(path, MAX_BYTES), type=kind, strict=False)
    except (OSError, msgspec.MsgspecError) as error:
        raise dataset.mismatch(path, "the layout of 2025", error) from error
