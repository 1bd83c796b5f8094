"""Rendered candidates as input of the network, augmented against overfitting to renderings."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch  # type: ignore[import-not-found]
from torch import Tensor
from torch.nn import functional  # type: ignore[import-not-found]

from scripts.render_bodies.labels import MARGIN_PX, PIXEL_M, Kind
from scripts.train_body.network import SIZE_PX
from scripts.train_embedding.augment import chance, lit, noisy, uniform
from scripts.train_embedding.training import on_device

REACH_M, RELIEF_M = 0.6, 0.2  # limits of relative depth and of relief [m], as at run time
LIMIT = 0.98  # minimum magnitude of a channel at its limit
LAYER_SIGMA_M = 0.03  # standard deviation of additional errors of layers [m]
BLOCK_PX = 4  # [px] side of blocks without readings


class Batch(NamedTuple):
    """Input of the network and labels of N candidates."""

    images: Tensor  # Nx7x48x32
    offsets_m: Tensor  # [m] Nx3 right, down and along the line of sight; NaN: unknown
    person: Tensor  # N, 1: person, 0: other
    share: Tensor  # N visible shares, 0 to 1


@dataclass(frozen=True)
class Samples:
    """Rendered candidates, see scripts/render_bodies."""

    colours: Tensor  # Nx3xHxW bytes, with margins
    depths: Tensor  # Nx4xHxW, -127 to 127: mask, relative depth, relief, readings
    offsets_m: Tensor  # [m] Nx3
    kinds: Tensor  # N, see `Kind`
    shares: Tensor  # N

    @classmethod
    def read(cls, paths: Sequence[Path]) -> "Samples":
        """Read files, at least one."""
        parts = {name: list[np.ndarray]() for name in cls.__dataclass_fields__}
        for path in paths:
            with np.load(path) as file:
                for name, arrays in parts.items():
                    arrays.append(file[name])
        return cls(**{name: on_device(np.concatenate(arrays)) for name, arrays in parts.items()})

    def batch(self, chosen: Tensor) -> Batch:
        """Return samples as they are, without margins."""
        return self._cut(chosen, torch.full((2, len(chosen)), MARGIN_PX))

    def augmented(self, chosen: Tensor) -> Batch:
        """Return augmented samples: shifted, mirrored, in other light, with errors of depth."""
        count = len(chosen)
        shifts = torch.randint(0, 2 * MARGIN_PX + 1, (2, count))
        images, offsets_m, person, share = self._cut(chosen, shifts)
        mirrored = torch.rand(count) < 0.5
        images = torch.where(mirrored[:, None, None, None], images.flip(3), images)
        right_m, down_m, along_m = offsets_m.T
        error_m = torch.randn(count) * LAYER_SIGMA_M
        offsets_m = torch.stack(
            [torch.where(mirrored, -right_m, right_m), down_m, along_m - error_m], 1
        )
        depths = without_blocks(with_errors(images[:, 3:], error_m))
        rgb = softened(lit(images[:, :3], torch.randint(0, count, (count,))))
        return Batch(torch.cat([rgb, depths], 1), offsets_m, person, share)

    def _cut(self, chosen: Tensor, corners_px: Tensor) -> Batch:
        """Return samples from upper left corners (2xN: row and column in the stored images)."""
        row, column = corners_px
        parts = [
            stored.unfold(2, SIZE_PX[0], 1).unfold(3, SIZE_PX[1], 1)[chosen, :, row, column] / scale
            for stored, scale in ((self.colours, 255), (self.depths, 127))
        ]
        down_m, right_m = (corners_px - MARGIN_PX) * PIXEL_M
        shifts_m = torch.stack([right_m, down_m, torch.zeros(len(chosen))], 1)
        person = (self.kinds[chosen] == Kind.PERSON).float()
        return Batch(
            torch.cat(parts, 1), self.offsets_m[chosen] - shifts_m, person, self.shares[chosen]
        )


def with_errors(depths: Tensor, error_m: Tensor) -> Tensor:
    """Return Nx4xHxW channels of depth with errors of the layers (N, in metres) and noise."""
    count = len(depths)
    mask, behind, relief, read = depths.unbind(1)
    shift_m = error_m[:, None, None] * read
    sigma_m = chance(count, 0.3)[:, 0] * uniform(count, 0, 0.02)[:, 0]
    noise_m = sigma_m * torch.randn_like(behind) * read
    changed = []
    for values, limit_m in ((behind, REACH_M), (relief, RELIEF_M)):
        shifted = torch.where(values.abs() < LIMIT, values - shift_m / limit_m, values)
        changed.append((shifted + noise_m / limit_m).clamp(-1, 1))
    return torch.stack([mask, *changed, read], 1)


def without_blocks(depths: Tensor) -> Tensor:
    """Return Nx4xHxW channels of depth, some without the readings of blocks, few without any."""
    count, _, height, width = depths.shape
    blocks = torch.rand(count, 1, height // BLOCK_PX, width // BLOCK_PX)
    lost = (blocks < uniform(count, 0.05, 0.6)) & chance(count, 0.12) | chance(count, 0.02)
    lost = functional.interpolate(lost.float(), scale_factor=float(BLOCK_PX))
    mask = torch.maximum(depths[:, :1], lost)
    return torch.cat([mask, depths[:, 1:] * (1 - lost)], 1)


def softened(rgb: Tensor) -> Tensor:
    """Return images with noise, some blurred or small."""
    count = len(rgb)
    soft = functional.avg_pool2d(rgb, 3, 1, 1, count_include_pad=False)
    rgb = torch.where(chance(count, 0.25), soft, rgb)
    streaked = functional.avg_pool2d(rgb, (1, 3), 1, (0, 1), count_include_pad=False)
    rgb = torch.where(chance(count, 0.15), streaked, rgb)
    coarse = functional.interpolate(functional.avg_pool2d(rgb, 2), rgb.shape[2:], mode="bilinear")
    rgb = torch.where(chance(count, 0.15), coarse, rgb)
    return noisy(rgb, 0.04)
