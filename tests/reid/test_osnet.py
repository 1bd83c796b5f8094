from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from common.inference.session import Array
from people4d.errors import ConfigError, ModelError
from people4d.messages import Crop
from services.reid.appearance import AppearanceEmbedder
from services.reid.config import ReidConfig
from services.reid.embedders import load_embedder
from services.reid.histogram import HistogramEmbedder
from services.reid.osnet import OsnetEmbedder


@dataclass
class MeanColour:
    """A network whose vectors are the mean colours of its input."""

    input_shape: tuple[int | None, ...] = (None, 3, 256, 128)
    input_dtype: np.dtype[np.generic] = field(default_factory=lambda: np.dtype(np.float32))
    runs: list[tuple[int, ...]] = field(default_factory=list)
    flat: bool = True

    def run(self, image: Array) -> Mapping[str, Array]:
        self.runs.append(image.shape)
        return {"output": np.asarray(image, np.float32).mean(axis=(2, 3) if self.flat else 3)}


def crop(*colour: int) -> Crop:
    return Crop(detection=0, rgb=np.full((60, 20, 3), colour, np.uint8))


def test_images_are_normalised_as_for_imagenet() -> None:
    # Red: (255 / 255 - 0.485) / 0.229 = 2.2489; green: (0 - 0.456) / 0.224 = -2.0357;
    # blue: (51 / 255 - 0.406) / 0.225 = -0.9156; then divided by the length 3.1690.
    vectors = OsnetEmbedder(MeanColour()).embed([crop(255, 0, 51)])
    expected = np.array([2.2489, -2.0357, -0.9156]) / 3.1690
    np.testing.assert_allclose(vectors[0], expected, atol=1e-3)


def test_crops_go_in_one_batch_if_the_network_can() -> None:
    crops = [crop(255, 0, 0), crop(0, 255, 0), crop(0, 0, 255)]
    many, single = MeanColour(), MeanColour(input_shape=(1, 3, 256, 128))
    together = OsnetEmbedder(many).embed(crops)
    one_by_one = OsnetEmbedder(single).embed(crops)
    assert many.runs[1:] == [(3, 3, 256, 128)]
    assert single.runs[1:] == [(1, 3, 256, 128)] * 3
    np.testing.assert_allclose(together, one_by_one, atol=1e-6)


def test_other_networks_are_refused() -> None:
    with pytest.raises(ModelError, match=r"expected an input of Nx3xHxW, got \[1, 256, 128, 3\]"):
        OsnetEmbedder(MeanColour(input_shape=(1, 256, 128, 3)))
    with pytest.raises(ModelError, match="expected an output of NxD"):
        OsnetEmbedder(MeanColour(flat=False))


def test_embedders_are_made_by_name() -> None:
    assert isinstance(load_embedder(ReidConfig()), AppearanceEmbedder)
    outside = ReidConfig(embedder="services.reid.histogram:load")
    assert isinstance(load_embedder(outside), HistogramEmbedder)
    with pytest.raises(
        ConfigError, match=r"'osnat' is unknown\. Choose appearance, histogram, osnet"
    ):
        load_embedder(ReidConfig(embedder="osnat"))
    with pytest.raises(ConfigError, match="cannot be loaded: No module named 'absent'"):
        load_embedder(ReidConfig(embedder="absent:Embedder"))


def test_a_missing_network_is_reported() -> None:
    with pytest.raises(ModelError, match=r"model file /nowhere\.onnx does not exist"):
        load_embedder(ReidConfig(embedder="osnet", model="/nowhere.onnx"))
    with pytest.raises(ModelError, match=r"Did you mean osnet-x0\.25-msmt17"):
        load_embedder(ReidConfig(embedder="osnet", model="osnet-x0.25-msmt1"))


def test_the_real_network_separates_people(shared: Path) -> None:
    file = shared / "data" / "models" / "osnet_x0_25_msmt17.onnx"
    embedder = load_embedder(ReidConfig(embedder="osnet", model=str(file)))
    rng = np.random.default_rng(0)
    one = rng.integers(0, 256, (200, 80, 3)).astype(np.uint8)
    striped = np.zeros((200, 80, 3), np.uint8)
    striped[::20] = 250
    crops = [Crop(detection=i, rgb=rgb) for i, rgb in enumerate((one, one, striped))]
    vectors = embedder.embed(crops)
    assert (embedder.name, embedder.dimension, vectors.shape) == ("osnet", 512, (3, 512))
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-5)
    np.testing.assert_allclose(vectors[0], vectors[1], atol=1e-5)
    assert vectors[0] @ vectors[2] < 0.9
    np.testing.assert_allclose(embedder.embed(crops[::-1]), vectors[::-1], atol=1e-5)
