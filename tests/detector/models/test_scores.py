import numpy as np
import pytest

from services.detector.models.movenet import MoveNet
from services.detector.models.scores import ScoreCalibration
from services.detector.models.yolo import YoloPose
from services.detector.models.yolo_seg import YoloSeg


def test_a_score_is_the_probability_of_a_person() -> None:
    # 1 / (1 + (0.1 / s)^2): 0.05: 1 / 5; 0.1: 1 / 2; 0.2: 4 / 5.
    calibration = ScoreCalibration(midpoint=0.1, slope=2.0)
    np.testing.assert_allclose(calibration.probability([0.05, 0.1, 0.2]), [0.2, 0.5, 0.8])


def test_scores_at_the_limits_are_probabilities() -> None:
    probability = ScoreCalibration(midpoint=0.1, slope=30.0).probability([0.0, 1e-300, 1.0])
    np.testing.assert_allclose(probability, [0.0, 0.0, 1.0], atol=1e-12)


@pytest.mark.parametrize("kind", [MoveNet, YoloPose, YoloSeg])
def test_probabilities_grow_with_the_score(kind: type[MoveNet | YoloPose | YoloSeg]) -> None:
    probability = kind.calibration.probability(np.linspace(0.01, 1, 50))
    assert (np.diff(probability) > 0).all()
    assert probability[-1] > 0.98
