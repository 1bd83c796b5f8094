"""Scores of predictions, and predictions on recorded paths of pedestrians."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.lib.prediction.score import (
    PredictionPairs,
    predict_tracks,
    predict_walks,
    score_groups,
)
from evaluation.datasets.walks import read_walks
from people4d.errors import SourceError
from services.predictor.config import PredictorConfig
from tests import ROOT
from tests.builders import track, tracks

SEQ_ETH = ROOT.parent / "shared" / "data" / "trajectories" / "seq_eth"


def write_walks(folder: Path, rows: list[list[float]], groups: str = "") -> Path:
    """Write a scene: frame, person, x, y of each row."""
    table = [[f, p, x, 0, y, 0, 0, 0] for f, p, x, y in rows]
    np.savetxt(folder / "obsmat.txt", table)
    (folder / "groups.txt").write_text(groups, encoding="utf-8")
    return folder


def pair_walks(folder: Path) -> Path:
    """Write two people side by side at 1 m/s, and one in the opposite direction."""
    rows = []
    for number in range(20):
        ahead = 0.4 * number
        rows += [[10 * number + 1, 1, ahead, 0.0], [10 * number + 1, 2, ahead, 0.7]]
        rows += [[10 * number + 1, 3, 9.0 - ahead, 0.3]]
    return write_walks(folder, rows, "1 2\n\n")


def test_constant_velocity_and_truth_by_hand(tmp_path: Path) -> None:
    # Positions are 0, 1, 1 m at 0, 0.4, 0.8 s. Extrapolation from the second one at 2.5 m/s gives 1
    # + 0.4 * 2.5 = 2 m in place of 1 m.
    folder = write_walks(tmp_path, [[1, 5, 0.0, 0.0], [11, 5, 1.0, 0.0], [21, 5, 1.0, 0.0]])
    pairs, _ = predict_walks(read_walks(folder), PredictorConfig(step_s=0.4, steps=2))
    assert pairs.truth_m.shape == (2, 2, 2)  # the second and the third annotation
    np.testing.assert_allclose(pairs.truth_m[0, :, 0], [1.0, np.nan])
    np.testing.assert_allclose(pairs.constant_m[0, :, 0], [2.0, 3.0])
    with pytest.warns(RuntimeWarning, match="Mean of empty slice"):  # no position 0.8 s later
        assert pairs.constant_errors_m()[0] == pytest.approx(1.0)


def scored(error_m: float, motion: tuple[float, float, float]) -> PredictionPairs:
    """Build one prediction 3 s ahead with variance 1 m^2, for a person walking along x."""
    return PredictionPairs(
        horizons_s=np.array([3.0]),
        means_m=np.array([[[3.0, error_m]]]),
        covariances_m2=np.eye(2)[None, None],
        constant_m=np.array([[[3.0, 0.0]]]),
        truth_m=np.array([[[3.0, 0.0]]]),
        positions_m=np.zeros((1, 2)),
        velocities_mps=np.array([[1.0, 0.0]]),
        motion=np.array([motion]),
    )


def test_coverage_and_outcomes_by_hand() -> None:
    # The ellipse of 90 % has a radius of 2.146 standard deviations.
    assert scored(2.14, (0, 1, 0)).covered(0.9).tolist() == [1.0]
    assert scored(2.15, (0, 1, 0)).covered(0.9).tolist() == [0.0]
    assert scored(0.0, (0, 1, 0)).outcomes().tolist() == [1]


def test_groups_of_a_scene_are_scored(tmp_path: Path) -> None:
    walks = read_walks(pair_walks(tmp_path))
    _, messages = predict_walks(walks, PredictorConfig())
    score = score_groups(walks, messages)
    assert score.frame_precision == score.pair_precision == score.pair_recall == 1.0
    assert 0.5 < score.frame_recall < 1.0  # a group is found after a while


def test_tracks_are_compared_with_the_nearest_person() -> None:
    stamps = [number * 100_000_000 for number in range(80)]
    truth = {s: {"a": np.array([s / 1e9, 0.0]), "b": np.array([s / 1e9, 9.0])} for s in stamps}
    speed = np.array([2.0, 0.0, 0.0])  # wrong by 1 m/s
    messages = [
        tracks(track(position_m=np.array([s / 1e9, 0.1, 1.0]), velocity_mps=speed), stamp_ns=s)
        for s in stamps
    ]
    pairs = predict_tracks(messages, truth, PredictorConfig(steps=2))
    expected = np.hypot([0.5, 1.0], 0.1)
    np.testing.assert_allclose(pairs.constant_errors_m(), expected, atol=1e-6)


@pytest.mark.parametrize("text", ["1 2 3", "1 1 nan 0 0 0 0 0", "one"])
def test_other_files_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "obsmat.txt").write_text(text, encoding="utf-8")
    (tmp_path / "groups.txt").write_text("", encoding="utf-8")
    with pytest.raises(SourceError):
        read_walks(tmp_path)


@pytest.mark.slow
@pytest.mark.skipif(not SEQ_ETH.is_dir(), reason="reference data are absent")
def test_people_are_predicted_better_than_by_constant_velocity() -> None:
    """The test split, with calibrated ellipses."""
    pairs, _ = predict_walks(read_walks(SEQ_ETH), PredictorConfig())
    before, after = pairs.constant_errors_m(), pairs.errors_m()
    at = pairs.horizons_s.tolist().index(3.0)
    assert before[at] == pytest.approx(0.81, abs=0.01)  # as published with the data
    assert np.all(after <= before)
    assert after[at] <= 0.95 * before[at]
    covered = pairs.covered(0.9)
    assert np.all((covered >= 0.85) & (covered <= 0.95))
