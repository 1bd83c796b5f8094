"""Accuracy of a network of the detector on frames with ground truth."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from common.inference.onnx import OnnxSession
from common.runtime.node import Node
from evaluation.quantization.images import ORIENTATION
from evaluation.recordings.rendered import RenderedFrame, matches, yaw_error_deg
from people4d.messages import F64, Detection, Detections
from services.detector.build import build
from services.detector.config import DetectorConfig
from services.detector.models.registry import find_factory

# Maximum accepted losses, as in [PIC4SeR]
RECALL_LOSS_MAX = 0.01
POSITION_LOSS_MAX_M = 0.005
YAW_LOSS_MAX_DEG = 1.0
MODEL = "movenet-multipose"  # people model of an orientation network: float32, for any processor

Found = Mapping[tuple[int, int], Detection]  # detections by frame and person


@dataclass(frozen=True)
class AccuracyLoss:
    """Losses of a network compared with another; negative values are gains."""

    people: int  # number of views of people to be found
    recall: float  # loss of the share of found people
    position_m: float  # [m] growth of the mean position error of people that both found
    yaw_deg: float  # [deg] growth of the mean yaw error of these people
    score_scale: float  # median ratio of the scores of these people

    @property
    def acceptable(self) -> bool:
        """True if every loss is within its limit."""
        return (
            self.recall <= RECALL_LOSS_MAX
            and self.position_m <= POSITION_LOSS_MAX_M
            and self.yaw_deg <= YAW_LOSS_MAX_DEG
        )


def detect(path: Path, kind: str, frames: Sequence[RenderedFrame]) -> Found:
    """Return the detections of a network of a kind in frames, by frame and person."""
    settings: dict[str, object] = {"crops": False, "scores": "network", "model": MODEL}
    if kind == ORIENTATION:
        settings["orientation"] = {"network": str(path)}
    config = msgspec.convert(settings, DetectorConfig)
    if kind == ORIENTATION:
        return found_by(build(config), frames)
    return found_by(build(config, find_factory(kind)(OnnxSession(path), config, kind)), frames)


def found_by(node: Node, frames: Sequence[RenderedFrame]) -> Found:
    """Return the detections of a detector in frames, by frame and person."""
    found: dict[tuple[int, int], Detection] = {}
    for number, rendered in enumerate(frames):
        node.handle(rendered.info, 0)
        output = node.handle(rendered.frame, 0)[-1]
        assert isinstance(output, Detections)
        for index, detection in matches(rendered.people, output.detections).items():
            found[number, index] = detection
    return found


def compare(frames: Sequence[RenderedFrame], reference: Found, found: Found) -> AccuracyLoss:
    """Return the loss of accuracy of a network relative to a reference."""
    people = sum(len(rendered.people) for rendered in frames)
    both = sorted(reference.keys() & found.keys())
    errors = np.array([[*_errors(frames, k, reference), *_errors(frames, k, found)] for k in both])
    errors = errors.reshape(-1, 4)
    position_m, yaw_deg = _growth(errors[:, 0], errors[:, 2]), _growth(errors[:, 1], errors[:, 3])
    recall = (len(reference) - len(found)) / max(people, 1)
    scales = [found[key].score / max(reference[key].score, 1e-6) for key in both]
    scale = float(np.median(scales)) if both else 1.0
    return AccuracyLoss(people, recall, position_m, yaw_deg, scale)


def _growth(before: F64, after: F64) -> float:
    """Return the mean growth of errors (N, NaN if not estimated).

    0 if the reference estimates nothing: a network without keypoints has no yaws.
    """
    if len(before) and np.isnan(before).all():
        return 0.0
    both = np.isfinite(before) & np.isfinite(after)
    return float(np.mean((after - before)[both])) if both.any() else math.inf


def _errors(
    frames: Sequence[RenderedFrame], key: tuple[int, int], found: Found
) -> tuple[float, float]:
    """Return the errors of position (m) and yaw (deg) of one person; NaN if not estimated."""
    (number, index), detection = key, found[key]
    rendered = frames[number]
    position_m = math.nan
    if detection.position_m is not None:
        position_m = float(np.linalg.norm(detection.position_m - rendered.positions_m[index]))
    return position_m, abs(yaw_error_deg(rendered, index, detection))
