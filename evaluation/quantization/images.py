"""Inputs for calibration: frames of the virtual lab, and images of a folder."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from common.inference.session import Array, Session
from evaluation.recordings.rendered import RenderedFrame
from people4d.errors import ConfigError
from people4d.messages import F32, U8
from services.detector.config import DetectorConfig
from services.detector.models.network import NetworkModel
from services.detector.models.registry import find_factory
from services.detector.orientation.network import upper_bodies
from services.detector.position.surface import DepthImage

# Scenario, seed and frames, all outside the test split
CALIBRATION = (
    ("three_crossing", 41, range(0, 400, 20)),
    ("short_sit", 42, range(0, 240, 24)),
    ("four_crossing", 44, range(40, 400, 24)),
)
ORIENTATION = "orientation"  # kind of orientation networks
SUFFIXES = {".jpg", ".jpeg", ".png"}


def images_of(folder: Path) -> Iterator[U8]:
    """Yield the images (HxWx3, RGB) of a folder by name; ConfigError if one is unreadable."""
    try:
        files = sorted(file for file in folder.iterdir() if file.suffix.lower() in SUFFIXES)
    except OSError as error:
        raise ConfigError(f"folder {folder} cannot be read: {error.strerror}") from error
    if not files:
        raise ConfigError(f"folder {folder} has no image", f"Expected {', '.join(SUFFIXES)}.")
    for file in files:
        image = cv2.imread(str(file), cv2.IMREAD_COLOR)
        if image is None:
            raise ConfigError(f"image {file} cannot be read")
        yield np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def inputs(session: Session, kind: str, images: Sequence[U8]) -> list[Array]:
    """Return images as the input of a people model of a kind; ConfigError if it is unknown."""
    model = find_factory(kind)(session, DetectorConfig(), kind)
    if not isinstance(model, NetworkModel):
        raise ConfigError(f"models of kind {kind} cannot be quantised here")
    return [model.input_of(image)[1] for image in images]


def bodies_of(rendered: RenderedFrame) -> F32:
    """Return the N people of a frame as input of the orientation network, Nx4x64x48."""
    keypoints = np.zeros((len(rendered.people), 17, 3), np.float32)
    keypoints[:, :, :2] = [person.keypoints_px for person in rendered.people]
    image = DepthImage(rendered.frame.depth_mm, rendered.info)
    depths_m = np.array(rendered.positions_m)[:, 2]
    return upper_bodies(rendered.frame.rgb, image, keypoints, depths_m)
