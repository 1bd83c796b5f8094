"""ETH and UCY: paths, errors of predictions and wrong files."""

from pathlib import Path

import numpy as np
import pytest

from evaluation.datasets.dataset import DatasetJob
from evaluation.datasets.eth_ucy import ETH_UCY, PREDICTED
from evaluation.datasets.walks import read_walks
from people4d.errors import ConfigError, SourceError
from tests.evaluation.datasets.people import lab_people


def write_scene(folder: Path, paths_m: list[np.ndarray], name: str = "ETH/seq_eth") -> Path:
    """Write paths (Nx2) of people, an annotation each 6 frames."""
    lines = [
        f"{780 + 6 * k:e} {person:e} {x:e} 0 {y:e} 0 0 0\n"
        for person, path in enumerate(paths_m, 1)
        for k, (x, y) in enumerate(path)
    ]
    (folder / name).mkdir(parents=True)
    (folder / name / "obsmat.txt").write_text("".join(lines))
    (folder / name / "groups.txt").write_text("1 2\n")
    return folder


def job(folder: Path, name: str = "ETH/seq_eth") -> DatasetJob:
    (method,) = ETH_UCY.methods([], [])
    return DatasetJob(folder, name, method, folder)


def test_paths_of_the_lab_are_read_back(tmp_path: Path) -> None:
    frames = lab_people()
    paths_m = [np.array([people[k].position_m[:2] for people in frames]) for k in (0, 1)]
    write_scene(tmp_path, paths_m)
    assert list(ETH_UCY.sequences(tmp_path)) == ["ETH/seq_eth"]
    walks = read_walks(tmp_path / "ETH" / "seq_eth")
    assert np.unique(np.diff(np.unique(walks.times_s))) == pytest.approx(0.4)
    np.testing.assert_allclose(walks.positions_m[walks.ids == 2], paths_m[1], atol=1e-6)
    assert walks.groups == {frozenset({1, 2})}


def test_errors_of_constant_velocity_by_hand(tmp_path: Path) -> None:
    # 1 m an annotation along x for 8 annotations, then along y: after k more of them constant
    # velocity is off by k along both axes, by k sqrt(2): mean 6.5 sqrt(2), at the end 12 sqrt(2).
    ahead = np.column_stack([np.arange(8.0), np.zeros(8)])
    aside = np.column_stack([np.full(PREDICTED, 7.0), np.arange(1.0, PREDICTED + 1)])
    write_scene(tmp_path, [np.vstack([ahead, aside])])
    result = ETH_UCY.evaluate(job(tmp_path))
    assert result.figures is not None
    row = result.figures.row()
    assert row["paths"] == 1
    assert row["constant_ade_m"] == pytest.approx(6.5 * 2**0.5)
    assert row["constant_fde_m"] == pytest.approx(12 * 2**0.5)
    assert (result.figures + result.figures).row()["constant_fde_m"] == pytest.approx(12 * 2**0.5)
    assert not result.submission


def test_a_person_who_walks_straight_is_predicted(tmp_path: Path) -> None:
    straight = np.column_stack([0.5 * np.arange(30), np.zeros(30)])
    result = ETH_UCY.evaluate(job(write_scene(tmp_path, [straight])))
    assert result.figures is not None
    row = result.figures.row()
    assert row["paths"] == 30 - 8 + 1 - PREDICTED
    assert row["constant_fde_m"] == pytest.approx(0.0, abs=1e-6)
    assert row["ade_m"] is not None
    assert row["ade_m"] < 0.5


@pytest.mark.slow
def test_constant_velocity_on_seq_hotel_is_that_of_the_reference(shared: Path) -> None:
    # The reference data state 0.34 and 0.66 m, computed apart from this code.
    result = ETH_UCY.evaluate(job(shared / "data" / "trajectories", "seq_hotel"))
    assert result.figures is not None
    row = result.figures.row()
    assert row["constant_ade_m"] == pytest.approx(0.34, abs=0.005)
    assert row["constant_fde_m"] == pytest.approx(0.66, abs=0.005)
    assert (row["ade_m"] or np.inf) < 0.8 * (row["constant_ade_m"] or 0)


def test_a_short_scene_has_no_paths(tmp_path: Path) -> None:
    result = ETH_UCY.evaluate(job(write_scene(tmp_path, [np.zeros((5, 2))])))
    assert result.figures is not None
    assert result.figures.row()["paths"] == 0


def test_half_a_download_is_named(tmp_path: Path) -> None:
    (write_scene(tmp_path, [np.zeros((5, 2))]) / "ETH" / "seq_eth" / "groups.txt").unlink()
    with pytest.raises(SourceError, match=r"expected groups.txt, got obsmat.txt"):
        ETH_UCY.sequences(tmp_path)


def test_four_columns_of_another_distribution_are_refused(tmp_path: Path) -> None:
    path = write_scene(tmp_path, [np.zeros((5, 2))]) / "ETH" / "seq_eth"
    (path / "obsmat.txt").write_text("780 1 8.45 3.58\n790 1 9.57 3.79\n")
    with pytest.raises(SourceError, match=r"obsmat.txt: expected 8 finite columns, got 4"):
        read_walks(path)


def test_scene_of_the_test_split_is_refused_for_tuning() -> None:
    ETH_UCY.check_tuning(["ETH/seq_hotel", "UCY/zara01"])
    with pytest.raises(ConfigError, match="got ETH/seq_eth"):
        ETH_UCY.check_tuning(["ETH/seq_eth"])


def test_presets_are_refused() -> None:
    with pytest.raises(ConfigError, match="expected no preset and no setting, got image-sort"):
        ETH_UCY.methods(["image-sort"], [])


def test_a_scene_of_one_frame_is_refused(tmp_path: Path) -> None:
    write_scene(tmp_path, [np.zeros((1, 2))])
    with pytest.raises(SourceError, match="expected two or more frames, got 1"):
        ETH_UCY.evaluate(job(tmp_path))
