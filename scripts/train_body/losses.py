"""Loss of the body network, and its results in units of the labels."""

from typing import NamedTuple

import torch  # type: ignore[import-not-found]
from torch import Tensor
from torch.nn import functional  # type: ignore[import-not-found]

from scripts.train_body.samples import Batch

SCALE_M = 0.3  # unit of the offsets [m], as at run time
SIGMA_MIN_M = 0.01  # minimum standard deviation [m], as at run time
SHARE_MIN = 0.12  # visible share below which a person has less weight
ROBUST = 4.0  # half squared errors above this grow by their logarithm only
LEVEL = [0, 2]  # axes of the joint covariance: right, and along the line of sight


class Estimates(NamedTuple):
    """Positions by N outputs of the network."""

    offsets_m: Tensor  # [m] Nx3 right, down and along the line of sight
    factors_m: Tensor  # [m] Nx2x2 Cholesky factors of the covariance to the right and along
    sigmas_m: Tensor  # [m] N standard deviations downward


def estimates(outputs: Tensor) -> Estimates:
    """Return the positions by outputs of the network, Nx9."""
    _, _, right, along, first, both, second, down, sigma = outputs.T
    offsets_m = SCALE_M * torch.stack([right, down, along], 1)
    upper = torch.stack([positive(first), torch.zeros_like(both)], 1)
    factors_m = torch.stack([upper, torch.stack([both, positive(second)], 1)], 1)
    return Estimates(offsets_m, factors_m, positive(sigma))


def positive(values: Tensor) -> Tensor:
    """Return the softplus of values, at least the minimum standard deviation."""
    return functional.softplus(values) + SIGMA_MIN_M


def normalised(estimate: Estimates, offsets_m: Tensor) -> Tensor:
    """Return errors to the right and along, in standard deviations, Nx2."""
    errors_m = (offsets_m - estimate.offsets_m)[:, LEVEL, None]
    return torch.linalg.solve_triangular(estimate.factors_m, errors_m, upper=False).squeeze(2)


def loss(outputs: Tensor, batch: Batch) -> Tensor:
    """Return the weighted sum of the losses of person, and of share and known position."""
    hardly = (batch.person > 0.5) & (batch.share < SHARE_MIN)
    weights = torch.where(hardly, 0.3, 1.0)
    people = functional.binary_cross_entropy_with_logits(outputs[:, 0], batch.person, weights)
    own = (batch.person > 0.5) & batch.offsets_m.isfinite().all(1)
    if not own.any():
        return people
    share = functional.binary_cross_entropy_with_logits(outputs[own, 1], batch.share[own])
    return (
        people + 0.2 * share + position_loss(outputs[own], batch.offsets_m[own], batch.share[own])
    )


def position_loss(outputs: Tensor, offsets_m: Tensor, share: Tensor) -> Tensor:
    """Return the robust negative log likelihood of positions; occluded people count twice."""
    estimate = estimates(outputs)
    weights = torch.where(share < 0.5, 2.0, 1.0)
    level = robust(normalised(estimate, offsets_m).square().sum(1) / 2)
    level = level + estimate.factors_m.diagonal(dim1=1, dim2=2).log().sum(1)
    down = (offsets_m - estimate.offsets_m)[:, 1] / estimate.sigmas_m
    height = robust(down.square() / 2) + estimate.sigmas_m.log()
    return (weights * (0.3 * level + 0.2 * height)).mean()


def robust(halves: Tensor) -> Tensor:
    """Return half squared errors whose growth is logarithmic above a limit."""
    return torch.where(
        halves > ROBUST, ROBUST * (1 + (halves.clamp(min=ROBUST) / ROBUST).log()), halves
    )
