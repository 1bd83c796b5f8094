"""RGB-D frames from folders of images: TUM's lists and numbered pairs."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import numpy.typing as npt

from common.config import Config
from common.io.files import read_bytes
from common.io.image_header import MAX_FILE_BYTES
from common.io.images import decode_image
from common.io.npz import read_array, read_arrays
from people4d.errors import DecodeError, SourceError
from people4d.messages import F64, U8, U16, Odometry
from people4d.messages.base import NonNegative, Positive
from services.camera.alignment import align
from services.camera.calibration import Calibration, read_calibration, static_transform
from services.camera.folder.layout import LISTS, ImagePair, listed, named, wheel_odometry
from services.camera.folder.mat_file import read_mat
from services.camera.ros.images import millimetres
from services.camera.source import Source, SourceFrame

# Names of calibration files; the first in the folder is used unless one is configured
CALIBRATIONS = (
    *("camera.toml", "camera.json", "camera_info.yaml", "gt.npz", "CalibrationData.mat"),
    *("camera_intrinsic.json", "intrinsic.json"),  # Open3D's recorders
    *("camera_matrix.csv", "camera-intrinsics.txt"),  # Stray Scanner, 7-Scenes
)
TRACK = "gt.npz"
MAT_DEPTH = "depth_array"  # name of the depth image in .mat files
HEADS = 9  # number of first pairs that determine the size of images


class FolderOptions(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Options of a folder of images."""

    colour: str = ""  # pattern of the colour images, "rgb/*.jpg"; empty: the usual ones
    depth: str = ""  # pattern of the depth images or .mat files
    fps: Positive = 30.0  # [Hz] frame rate of numbered pairs without times
    track: str = ""  # NPZ with times `t` [s] and `odom`; empty: gt.npz in the folder
    # [s] maximum time difference of pairs from lists, as in TUM's tools
    sync_slop_s: NonNegative = 0.02
    depth_scale: NonNegative = 0.0  # depth units per metre; 0: 1000, of lists 5000, of float 1
    calibration: str = ""  # calibration file; empty: one of the usual names in the folder
    # [px] u, v, see Registration; absent: as in the calibration file
    depth_offset_px: tuple[float, float] | None = None


class FolderSource(Source):
    """Plays the image pairs of a folder; SourceError if it lacks pairs or a fitting calibration."""

    options_type = FolderOptions

    def __init__(self, path: Path, options: FolderOptions) -> None:
        self.counters: Counter[str] = Counter()
        self._options = options
        tum = all((path / name).is_file() for name in LISTS) and not options.colour
        self._units_per_m = options.depth_scale or (5000.0 if tum else 1000.0)
        times_s, self.odometry = _track(path, options)
        if tum:
            layout = listed(path, options.sync_slop_s)
        else:
            stamps = options.fps if times_s is None else times_s
            patterns = options.colour, options.depth
            layout = named(path, patterns, stamps, options.sync_slop_s)
        self.pairs = layout.pairs
        self.counters["unpaired"] = layout.unpaired
        size, depth_size = self._sizes()
        calibration = _calibration(path, options)
        if calibration.colour is None:
            raise SourceError(
                f"folder {path} has no calibration ({', '.join(CALIBRATIONS)})",
                "Write camera.toml with fx, fy, cx and cy, or set options.calibration to a file.",
            )
        self.alignment = align(calibration, calibration.colour, size, depth_size)
        self.info, self.registration = self.alignment.info, self.alignment.registration
        if calibration.parent_from_optical is not None:
            matrix = np.array(calibration.parent_from_optical)
            parent = calibration.parent
            self.transforms = [static_transform(parent, self.info.frame_id, matrix)]

    def __iter__(self) -> Iterator[SourceFrame | Odometry]:
        """Yield the frames, each after the odometry up to its time."""
        odometry = iter(self.odometry)
        ahead = next(odometry, None)
        for pair in self.pairs:
            while ahead and ahead.stamp_ns <= pair.stamp_ns:
                yield ahead
                ahead = next(odometry, None)
            try:
                rgb, depth_mm = self.alignment(*self._read(pair))
            except (SourceError, ValueError):  # ValueError: depth changed its size
                self.counters["bad_images"] += 1
                continue
            yield SourceFrame(rgb, depth_mm, pair.stamp_ns)

    def _sizes(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Return the most common sizes of colour and depth in the first readable pairs."""
        sizes, reason = Counter[Any](), SourceError("it has no pairs")
        for pair in self.pairs:
            try:
                rgb, depth = self._read(pair)
            except SourceError as error:
                reason = error
                continue
            sizes[rgb.shape[:2], depth.shape] += 1
            if sizes.total() == HEADS:
                break
        if not sizes:
            raise reason
        (size, depth_size), _ = sizes.most_common(1)[0]
        return size, depth_size

    def _read(self, pair: ImagePair) -> tuple[U8, U16]:
        rgb, depth = _read_image(pair.colour, cv2.IMREAD_COLOR_RGB), _read_image(pair.depth)
        if depth.ndim != 2 or depth.dtype not in (np.uint16, np.float32):
            raise SourceError(
                f"{pair.depth}: expected 16 bits grey, got {depth.dtype} of shape {depth.shape}",
                "Write depth as uint16 in millimetres or float32 in metres, one channel.",
            )
        if depth.dtype == np.float32:
            depth = millimetres(depth / np.float32(self._options.depth_scale or 1.0))
        elif self._units_per_m != 1000:
            depth = millimetres(depth / np.float32(self._units_per_m))
        return np.asarray(rgb, np.uint8), np.asarray(depth)


def _track(path: Path, options: FolderOptions) -> tuple[F64 | None, list[Odometry]]:
    """Read times and odometry from an NPZ, if there is one."""
    file = Path(options.track) if options.track else path / TRACK
    if not options.track and not file.is_file():
        return None, []
    try:
        arrays = read_arrays(file, ["t"], ["odom"])
    except (OSError, ValueError) as error:
        raise SourceError(f"track {file} cannot be read: {error}") from error
    times_s = np.asarray(arrays["t"], np.float64)
    odometry = arrays.get("odom")
    return times_s, [] if odometry is None else wheel_odometry(times_s, odometry)


def _calibration(path: Path, options: FolderOptions) -> Calibration:
    """Read the calibration file, with the depth offset of the options if set."""
    files = [Path(options.calibration)] if options.calibration else []
    files += [path / name for name in CALIBRATIONS if (path / name).is_file()]
    calibration = read_calibration(files[0]) if files else Calibration()
    if options.depth_offset_px is None:
        return calibration
    return msgspec.structs.replace(calibration, depth_offset_px=options.depth_offset_px)


def _read_image(path: Path, flags: int = cv2.IMREAD_UNCHANGED) -> npt.NDArray[Any]:
    """Read an image, or the array of a .mat or .npy file; SourceError if there is none."""
    try:
        if not path.is_file():  # opening a pipe would block
            raise SourceError(f"{path} is not a file")
        if path.suffix == ".mat":
            return np.asarray(read_mat(path)[MAT_DEPTH])
        if path.suffix == ".npy":
            return read_array(path)
        return decode_image(read_bytes(path, MAX_FILE_BYTES), flags)
    except KeyError as error:
        raise SourceError(f"{path} has no array {error}") from error
    except (OSError, ValueError, DecodeError) as error:
        raise SourceError(f"{path} is not a readable image: {error}") from error
