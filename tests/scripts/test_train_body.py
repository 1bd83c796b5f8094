"""Training of the body network, where torch is installed."""

import copy
from pathlib import Path

import numpy as np
import pytest

from people4d.messages import F32, U8
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
    kinds = np.arange(COUNT, dtype=np.uint8) % len(Kind)
    offsets_m = np.random.default_rng(0).normal(0, 0.1, (COUNT, 3)).astype(np.float32)
    offsets_m[kinds == Kind.EMPTY] = np.nan
    write(tmp_path / "000.npz", kinds, offsets_m)
    return tmp_path


def write(path: Path, kinds: U8, offsets_m: F32) -> None:
    rng = np.random.default_rng(0)
    np.savez(
        path,
        colours=rng.integers(0, 256, (COUNT, 3, 54, 38)).astype(np.uint8),
        depths=rng.integers(-127, 128, (COUNT, 4, 54, 38)).astype(np.int8),
        offsets_m=offsets_m,
        kinds=kinds,
        shares=rng.uniform(0, 1, COUNT).astype(np.float32),
    )


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


def test_detections_of_the_last_fifth_of_the_seeds_are_not_learned(folder: Path) -> None:
    unknown_m: F32 = np.full((COUNT, 3), np.nan, np.float32)
    for number in range(10):
        kinds = np.full(COUNT, Kind.ROBOT, np.uint8)
        write(folder / f"robot-{number:02}.npz", kinds, unknown_m)
    learned, held = (main.read_samples(folder, flag) for flag in (False, True))
    counts = {content: len(samples.kinds) for content, samples in learned.items()}
    assert counts == {main.BOXES: COUNT, "robot": 8 * COUNT}
    assert {content: len(samples.kinds) for content, samples in held.items()} == {
        "robot": 2 * COUNT
    }


def test_a_quarter_of_a_batch_is_detections(folder: Path) -> None:
    unknown_m: F32 = np.full((COUNT, 3), np.nan, np.float32)
    write(folder / "000.npz", np.full(COUNT, Kind.EMPTY, np.uint8), unknown_m)
    for content in filter(None, main.BATCH):
        kind = Kind.PERSON if content == "people" else Kind.ROBOT
        write(folder / f"{content}-00.npz", np.full(COUNT, kind, np.uint8), unknown_m)
    batch = main.draw_batch(main.read_samples(folder, held=False))
    assert batch.images.shape == (256, 7, 48, 32)
    assert sum(count for content, count in main.BATCH.items() if content) == 256 / 4
    assert batch.person.sum() == pytest.approx(256 / 12, abs=1)


def test_people_of_unknown_position_count_by_their_logit_only() -> None:
    # Logits of 0: cross entropy ln 2, whatever the other outputs are.
    outputs = torch.randn(4, 9)
    outputs[:, 0] = 0
    batch = losses.Batch(
        torch.zeros(4, 7, 48, 32), torch.full((4, 3), torch.nan), torch.ones(4), torch.ones(4)
    )
    assert float(losses.loss(outputs, batch)) == pytest.approx(np.log(2))


def test_samples_below_the_minimum_of_people_are_rejected(folder: Path) -> None:
    samples, network = main.Samples.read([folder / "000.npz"]), main.BodyNetwork()
    torch.nn.init.zeros_(network.head[-1].weight)
    for log_odds, share in ((-2.6, 1.0), (-2.4, 0.0)):
        torch.nn.init.constant_(network.head[-1].bias, log_odds)
        assert main.rejected(network, samples) == share
