"""AprilTags at measured positions, for calibrations in the map.

Poses by walking are relative to a reference camera. A camera with a tag of the family 36h11 at a
known position in view determines the poses of all cameras in the map.
"""

from collections import defaultdict, deque
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import cv2
import msgspec
import numpy as np
from msgspec import Meta
from scipy.spatial.transform import Rotation

from common.calibration.solve import CalibrationResult
from common.geometry.transform_history import displacement
from common.geometry.transforms import apply, camera_matrix, invert, transform_from
from common.io.files import read_toml
from people4d.errors import CalibrationError, SourceError
from people4d.messages import F32, F64, U8, CameraInfo
from people4d.messages.base import MAX_CAMERAS

Coordinate = Annotated[float, Meta(ge=-1e4, le=1e4)]  # [m]
FAMILY = cv2.aruco.DICT_APRILTAG_36h11
TAGS_MAX = 200  # maximum number of tags in a file
FIRST_PX = np.float32(0), np.float32(0.5)  # centre of the first pixel, by detector
EVERY_NS = 500_000_000  # [ns] interval of images of a camera used for detection
VIEWS_MAX = 40  # maximum number of views of one tag by one camera

ERROR_MAX_PX = 2.0  # maximum RMS error of the corners; above, position or size of a tag is wrong
# Error of a second possible pose below which a tag is ambiguous, relative to the first
AMBIGUOUS = 2.0
AMBIGUOUS_PX = 0.2  # [px] addition to the error of the first pose
# Maximum difference between a pose by tags and by walking [m, rad]
APART_M, APART_RAD = 0.15, np.radians(3)


class Tag(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An AprilTag on a wall, or flat on the floor or a table."""

    size_m: Annotated[float, Meta(ge=0.01, le=5)]  # [m] side of its black square
    position_m: tuple[Coordinate, Coordinate, Coordinate]  # [m] centre, frame: map
    # [deg] from x of the map towards y: direction of its normal; of its upper edge if it is flat
    facing_deg: Annotated[float, Meta(ge=-360, le=360)]
    flat: bool = False

    @property
    def corners_m(self) -> F64:
        """Corners (4x3) in the map: upper left, upper right, lower right, lower left."""
        angle = np.radians(self.facing_deg)
        direction, vertical = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([0, 0, 1.0])
        normal, up = (vertical, direction) if self.flat else (direction, vertical)
        signs = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
        axes = np.array([np.cross(up, normal), up])
        return np.asarray(np.array(self.position_m) + signs * self.size_m / 2 @ axes)


class TagsFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All tags of a site."""

    tags: dict[str, Tag] = {}  # tags by number


def read_tags(path: Path) -> dict[int, Tag]:
    """Read a file of tags by number; SourceError if it cannot be read, or a tag is impossible."""
    try:
        found = msgspec.convert(read_toml(path), TagsFile)
        tags = {int(number): tag for number, tag in found.tags.items()}
    except OSError as error:
        raise SourceError(f"tags {path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise SourceError(f"tags {path}: {error}") from error
    if not tags or len(tags) > TAGS_MAX:
        raise SourceError(f"tags {path}: expected 1 to {TAGS_MAX} tags, got {len(tags)}")
    return tags


class TagObserver:
    """Corners of known tags in the images of cameras.

    Args:
        tags: Known tags by number; other tags in the images are ignored.
    """

    def __init__(self, tags: Mapping[int, Tag]) -> None:
        self._tags = dict(tags)
        # Lines along the edges give the best corners, but not for all tags.
        methods = cv2.aruco.CORNER_REFINE_SUBPIX, cv2.aruco.CORNER_REFINE_APRILTAG
        self._detectors = [_detector(method) for method in methods]
        self._last_ns: dict[str, int] = {}
        self._corners: dict[str, dict[int, deque[F32]]] = {}

    def copy(self) -> "TagObserver":
        """Return a copy, unaffected by later images."""
        other = TagObserver(self._tags)
        other._corners = {
            camera: {number: views.copy() for number, views in views_of.items()}
            for camera, views_of in self._corners.items()
        }
        return other

    def wants(self, camera: str, stamp_ns: int) -> bool:
        """Check that another image of a camera is due."""
        last_ns = self._last_ns.get(camera)
        if last_ns is None:
            return len(self._last_ns) < MAX_CAMERAS
        return not 0 <= stamp_ns - last_ns < EVERY_NS

    def add_image(self, camera: str, stamp_ns: int, rgb: U8) -> None:
        """Detect tags in an image (HxWx3)."""
        self._last_ns[camera] = stamp_ns
        grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
        found = dict[int, F32]()
        for detector, first_px in zip(self._detectors, FIRST_PX, strict=True):
            corners, numbers, _ = detector.detectMarkers(grey)
            for one, number in zip(corners, np.ravel(numbers), strict=True) if corners else ():
                found[int(number)] = np.asarray(one, np.float32).reshape(4, 2) - first_px
        self.add_corners(camera, found)

    def add_corners(self, camera: str, pixels: Mapping[int, F32]) -> None:
        """Store the corners (4x2) of the tags in an image; unknown tags are ignored."""
        views = self._corners.setdefault(camera, defaultdict(lambda: deque(maxlen=VIEWS_MAX)))
        for known in sorted(pixels.keys() & self._tags.keys()):
            views[known].append(pixels[known])

    def poses(self, infos: Mapping[str, CameraInfo]) -> dict[str, F64]:
        """Return map_from_camera (4x4) of the cameras with tags in view.

        CalibrationError if a tag contradicts the file, or leaves two poses.
        """
        found = {}
        for camera, views in self._corners.items():
            if views and camera in infos:
                numbers = sorted(views)
                corners_m = np.concatenate([self._tags[n].corners_m for n in numbers])
                pixels = np.concatenate([np.median(views[n], axis=0) for n in numbers])
                found[camera] = _pose(infos[camera], corners_m, pixels, numbers)
        return found


def move_to_map(found: CalibrationResult, by_tags: Mapping[str, F64]) -> CalibrationResult:
    """Return a calibration by walking, moved rigidly to the poses by tags.

    CalibrationError if no tag was in view, or tags and walking contradict each other.
    """
    common = sorted(set(by_tags) & set(found.map_from_camera))
    if not common:
        raise CalibrationError("no camera saw a tag", "Bring a tag of the file into view.")
    moves = np.array([by_tags[name] @ invert(found.map_from_camera[name]) for name in common])
    rotation = Rotation.from_matrix(moves[:, :3, :3]).mean().as_matrix()
    origins = np.array([found.map_from_camera[name][:3, 3] for name in common])
    wanted = np.array([by_tags[name][:3, 3] for name in common])
    move = transform_from(wanted.mean(axis=0) - rotation @ origins.mean(axis=0), rotation)
    poses = {name: move @ matrix for name, matrix in found.map_from_camera.items()}
    for name in common:
        apart_m, apart_rad = displacement(invert(poses[name]) @ by_tags[name])
        if apart_m > APART_M or apart_rad > APART_RAD:
            raise CalibrationError(
                f"tags place {name} {100 * apart_m:.0f} cm and "
                f"{np.degrees(apart_rad):.1f} deg from the pose estimated from walking people",
                "Measure the positions of its tags again, or walk longer.",
            )
    paths = {
        name: [apply(move, path) for path in all_paths] for name, all_paths in found.paths_m.items()
    }
    return replace(found, map_from_camera=poses, paths_m=paths)


def _detector(refinement: int) -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = refinement
    return cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(FAMILY), parameters)


def _pose(info: CameraInfo, corners_m: F64, pixels: F64, numbers: Iterable[int]) -> F64:
    """Return map_from_camera by the corners of tags."""
    matrix, distortion = camera_matrix(info), np.array(info.distortion)
    flat = np.linalg.matrix_rank(corners_m - corners_m.mean(axis=0), tol=1e-6) < 3
    flags = cv2.SOLVEPNP_IPPE if flat else cv2.SOLVEPNP_SQPNP
    count, turns, shifts, _ = cv2.solvePnPGeneric(
        corners_m, pixels, matrix, distortion, flags=flags
    )
    solutions = []
    for turn, shift in zip(turns[:count], shifts[:count], strict=True):
        refined = cv2.solvePnPRefineLM(corners_m, pixels, matrix, distortion, turn, shift)
        projected, _ = cv2.projectPoints(corners_m, *refined, matrix, distortion)
        error_px = float(np.sqrt(((projected[:, 0] - pixels) ** 2).sum(axis=1).mean()))
        pose = transform_from(refined[1].ravel(), cv2.Rodrigues(refined[0])[0])
        solutions.append((error_px, invert(pose)))
    named = ", ".join(f"tag {number}" for number in numbers)
    if not solutions or min(s[0] for s in solutions) > ERROR_MAX_PX:
        raise CalibrationError(
            f"{named}: not where the file says, by {info.camera}",
            "Compare numbers, sizes, positions and directions.",
        )
    (error_px, pose), *others = sorted(solutions, key=lambda item: item[0])
    for other_px, other in others:
        _, apart_rad = displacement(invert(pose) @ other)
        if apart_rad > APART_RAD and other_px < AMBIGUOUS * (error_px + AMBIGUOUS_PX):
            raise CalibrationError(
                f"{named}: leave two poses of {info.camera}",
                "Bring another tag into its view that is not in the same plane, or a larger one.",
            )
    return pose
