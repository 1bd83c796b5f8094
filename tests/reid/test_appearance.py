from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest

from common.inference.session import Array
from people4d.errors import ModelError
from people4d.messages import U8, Crop
from services.reid.appearance import AppearanceEmbedder
from services.reid.config import ReidConfig
from services.reid.embedders import load_embedder


@dataclass
class MeanInput:
    """A network whose vectors are the means of the input channels."""

    input_shape: tuple[int | None, ...] = (None, 4, 48, 24)
    input_dtype: np.dtype[np.generic] = field(default_factory=lambda: np.dtype(np.float32))
    flat: bool = True

    def run(self, image: Array) -> Mapping[str, Array]:
        return {"output": np.asarray(image, np.float32).mean(axis=(2, 3) if self.flat else 3)}


def crop(rgb: U8, mask: U8 | None = None) -> Crop:
    return Crop(detection=0, rgb=rgb, mask=mask)


def clothed(upper: tuple[int, int, int], lower: tuple[int, int, int], size: int = 200) -> Crop:
    rgb = np.full((size, size // 2, 3), upper, np.uint8)
    rgb[size // 2 :] = lower
    return crop(rgb)


def test_the_network_gets_colours_and_the_mask_from_0_to_1() -> None:
    rgb = np.full((60, 20, 3), (255, 0, 51), np.uint8)
    mask = np.zeros((60, 20), np.uint8)
    mask[:30] = 1
    vectors = AppearanceEmbedder(MeanInput()).embed([crop(rgb), crop(rgb, mask)])
    means = np.array([(1, 0, 0.2, 1), (1, 0, 0.2, 0.5)])
    unit = means / np.linalg.norm(means, axis=1, keepdims=True)
    np.testing.assert_allclose(vectors, unit, atol=1e-6)


def test_other_networks_are_refused() -> None:
    with pytest.raises(ModelError, match=r"expected an input of Nx4xHxW, got \[None, 3, 8, 8\]"):
        AppearanceEmbedder(MeanInput(input_shape=(None, 3, 8, 8)))
    with pytest.raises(ModelError, match="expected an output of NxD"):
        AppearanceEmbedder(MeanInput(flat=False))
    with pytest.raises(ModelError, match=r"model file /nowhere\.onnx does not exist"):
        load_embedder(ReidConfig(embedder="appearance", model="/nowhere.onnx"))


def test_the_shipped_network_knows_clothes_again_in_other_light() -> None:
    embedder = load_embedder(ReidConfig(embedder="appearance"))
    red, dimmer = clothed((180, 40, 40), (30, 40, 90)), clothed((140, 30, 32), (22, 30, 70), 120)
    other = clothed((220, 220, 215), (90, 80, 60))
    vectors = embedder.embed([red, dimmer, other])
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-5)
    assert vectors[0] @ vectors[1] > vectors[0] @ vectors[2] + 0.1


def test_any_crop_has_a_vector() -> None:
    embedder = load_embedder(ReidConfig(embedder="appearance"))
    pixel, wide = np.zeros((1, 1, 3), np.uint8), np.full((3, 400, 3), 255, np.uint8)
    empty_mask = np.zeros((9, 9), np.uint8)
    crops = [crop(pixel), crop(wide), crop(np.zeros((9, 9, 3), np.uint8), empty_mask)]
    vectors = embedder.embed(crops)
    assert vectors.shape == (3, embedder.dimension)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-5)
    assert embedder.embed([]).shape == (0, embedder.dimension)
