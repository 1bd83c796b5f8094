"""The shipped MoveNet in int8 compared with float32, on frames of the shipped recording."""

import itertools
from dataclasses import astuple

import msgspec
import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from common.geometry.boxes import iou_xyxy
from common.io.images import decompress
from common.io.recording import open_recording
from deploy.cli.system.demo import DEMO
from people4d.messages import U8, CompressedRgbdFrame
from services.detector.config import ModelSettings
from services.detector.models.base import Limits
from services.detector.models.registry import load_model

INTEGERS = "movenet-multipose-int8"


@pytest.fixture(scope="module")
def images() -> list[U8]:
    messages = itertools.islice(open_recording(DEMO).messages(CompressedRgbdFrame), 20, 120, 12)
    frames = [message for _, message in messages if isinstance(message, CompressedRgbdFrame)]
    return [decompress(frame).rgb for frame in frames]


def test_people_are_found_as_in_float(images: list[U8]) -> None:
    plain, integers = (load_model(ModelSettings(model=m)) for m in ("movenet-multipose", INTEGERS))
    assert integers.name == INTEGERS
    of_plain = of_integers = both = 0
    scores = []
    for image in images:
        one, other = plain.detect(image), integers.detect(image)
        of_plain, of_integers = of_plain + len(one), of_integers + len(other)
        boxes = (np.array([p.box_xyxy_px for p in people], np.float64) for people in (one, other))
        overlap = iou_xyxy(*boxes)
        for i, j in zip(*linear_sum_assignment(-overlap), strict=True):
            if overlap[i, j] > 0.7:
                both += 1
                scores.append(other[j].score / one[i].score)
    assert of_plain >= 20
    assert both >= 0.9 * of_plain
    assert of_integers <= 1.1 * of_plain
    assert 0.7 < np.median(scores) < 1.3


def test_thresholds_belong_to_the_kind() -> None:
    settings = ModelSettings(score_min=0.1)
    scaled = msgspec.structs.replace(settings, score_scale=1.5)
    assert astuple(Limits.from_settings(settings, 0.05, 0.6)) == (0.1, 0.6, 20)
    assert Limits.from_settings(scaled, 0.05, 0.6).score_min == pytest.approx(0.15)
    absent = ModelSettings(score_scale=2.0)
    assert Limits.from_settings(absent, 0.05, 0.6).score_min == pytest.approx(0.1)
