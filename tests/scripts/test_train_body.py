"""Training of the body network, where torch is installed."""

import copy
from pathlib import Path

import numpy as np
import pytest

from people4d.messages import F32
from scripts.render_bodies.labels import Kind
from services.detector.position.body import BodyImages, BodyNetwork
from tests.detector.bodies import RowSession

NO_TORCH = "torch is installed for training only"
torch = pytest.importorskip("torch", reason=NO_TORCH)
main = pytest.importorskip("scripts.train_body.__main__", reason=NO_TORCH)
losses = pytest.importorskip("scripts.train_body.losses", reason=NO_TORCH)
training = pytest.importorskip("scripts.train_embedding.training", reason=NO_TORCH)

COUNT = 12


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    kinds = np.arange(COUNT, dtype=np.uint8) % len(Kind)
    offsets_m = rng.normal(0, 0.1, (COUNT, 3)).astype(np.float32)
    offsets_m[kinds == Kind.EMPTY] = np.nan
    np.savez(
        tmp_path / "000.npz",
        colours=rng.integers(0, 256, (COUNT, 3, 54, 38)).astype(np.uint8),
        depths=rng.integers(-127, 128, (COUNT, 4, 54, 38)).astype(np.int8),
        offsets_m=offsets_m,
        kinds=kinds,
        shares=rng.uniform(0, 1, COUNT).astype(np.float32),
    )
    return tmp_path


def test_two_steps_change_the_network_and_its_mean(folder: Path) -> None:
    torch.manual_seed(0)
    samples, network = main.Samples.read([folder / "000.npz"]), main.BodyNetwork()
    mean = copy.deepcopy(network)
    before = mean.head[-1].weight.clone()

    def loss_of_batch() -> object:
        batch = samples.augmented(torch.arange(COUNT))
        return losses.loss(network(batch.images), batch)

    for step in training.optimise(network, loss_of_batch, 2, 0.0, 5.0):
        main.average(mean, network, step)
    assert torch.isfinite(mean.head[-1].weight).all()
    assert not torch.equal(mean.head[-1].weight, before)
    assert "in the 90 % ellipse" in main.validate(mean, samples)


def test_a_shift_of_the_window_is_taken_off_the_offset(folder: Path) -> None:
    samples = main.Samples.read([folder / "000.npz"])
    chosen = torch.arange(COUNT)
    middle = samples.batch(chosen)
    # Two rows down and one column to the right
    corners = torch.tensor([5, 4])[:, None].expand(2, COUNT)
    moved = samples._cut(chosen, corners)
    torch.testing.assert_close(moved.images[:, :, :-2, :-1], middle.images[:, :, 2:, 1:])
    known = ~middle.offsets_m.isnan()[:, 0]
    torch.testing.assert_close(
        (middle.offsets_m - moved.offsets_m)[known],
        torch.tensor([0.0344, 2 * 0.0344, 0.0]).expand(int(known.sum()), 3),
    )


def test_outputs_have_the_meaning_of_run_time() -> None:
    values = [0.3, 0.1, 0.2, -0.4, 0.5, 0.05, -1.0, 0.7, -0.6]
    estimate = losses.estimates(torch.tensor([values]))
    network = BodyNetwork(RowSession(values))
    images: F32 = np.zeros((1, 7, 48, 32), np.float32)
    found = network.observe(BodyImages(images, np.array([[0.0, 0.0, 2.0]])))[0]
    assert found.covariance_m2 is not None
    np.testing.assert_allclose(
        found.position_m - [0, 0, 2], estimate.offsets_m[0].numpy(), atol=1e-6
    )
    factor = estimate.factors_m[0].numpy()
    flat = found.covariance_m2[np.ix_([0, 2], [0, 2])]
    np.testing.assert_allclose(flat, factor @ factor.T, atol=1e-6)
    assert found.covariance_m2[1, 1] == pytest.approx(float(estimate.sigmas_m[0]) ** 2)


def test_the_area_under_the_curve_is_the_share_of_ordered_pairs() -> None:
    # Two persons and two others: three of the four pairs are in order.
    score = torch.tensor([0.1, 0.4, 0.3, 0.9])
    assert main.area_under_curve(score, torch.tensor([False, False, True, True])) == 0.75
