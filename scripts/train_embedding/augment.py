"""Random changes of crops, so that the network does not learn what only renderings have."""

import torch  # type: ignore[import-not-found]
from torch import Tensor
from torch.nn import functional  # type: ignore[import-not-found]

from scripts.train_embedding.network import HEIGHT_PX, WIDTH_PX


def augment(crops: Tensor, views: int) -> Tensor:
    """Return crops as input of the network.

    Args:
        crops: Nx4xHxW bytes, the last channel is the mask; all crops of one person in a row.
        views: Number of crops of each person.
    """
    images = dyed(moved(crops.float() / 255), views)
    images = other_background(images)
    images = occluded(images)
    rgb, mask = images[:, :3], images[:, 3:]
    return torch.cat([blurred(lit(rgb)), used_mask(mask)], 1)


def uniform(count: int, low: float, high: float) -> Tensor:
    """Return Nx1x1x1 random numbers."""
    return torch.empty(count, 1, 1, 1).uniform_(low, high)


def chance(count: int, share: float) -> Tensor:
    """Return Nx1x1x1, true for a random share."""
    return uniform(count, 0, 1) < share


def dyed(images: Tensor, views: int) -> Tensor:
    """Return images in which some people have other colours, the same in all their views."""
    people = len(images) // views
    matrix = torch.eye(3) + 0.25 * torch.randn(people, 3, 3)
    order = torch.rand(people, 3).argsort(1)
    matrix = torch.gather(matrix, 1, order[:, :, None].expand(-1, -1, 3))
    matrix = matrix / matrix.sum(2, keepdim=True).clamp_min(0.3)
    matrix = matrix * torch.exp(0.5 * torch.randn(people, 1, 1))
    matrix = torch.where(torch.rand(people, 1, 1) < 0.5, matrix, torch.eye(3))
    light = torch.einsum("nij,njhw->nihw", matrix.repeat_interleave(views, 0), images[:, :3] ** 2.2)
    mask = images[:, 3:]
    rgb = mask * light.clamp(0, 1) ** (1 / 2.2) + (1 - mask) * images[:, :3]
    return torch.cat([rgb, mask], 1)


def moved(images: Tensor) -> Tensor:
    """Return images with boxes that are a little off, some mirrored."""
    count = len(images)
    theta = torch.zeros(count, 2, 3)
    turn = torch.randn(count) * 0.08
    flip = torch.where(torch.rand(count) < 0.5, -1.0, 1.0)
    scale = torch.exp(torch.randn(count, 2) * 0.1)
    theta[:, 0, 0], theta[:, 1, 1] = flip * scale[:, 0], scale[:, 1]
    theta[:, 0, 1], theta[:, 1, 0] = turn, -turn
    theta[:, :, 2] = torch.randn(count, 2) * 0.1
    # Some boxes are cut low, as by a desk or the image's edge
    cut = torch.where(
        torch.rand(count) < 0.15, torch.empty(count).uniform_(0.45, 0.9), torch.ones(1)
    )
    theta[:, 1, 2] += cut - 1
    theta[:, 1, 1] *= cut
    grid = functional.affine_grid(theta, [count, 4, HEIGHT_PX, WIDTH_PX], align_corners=False)
    return functional.grid_sample(images, grid, padding_mode="border", align_corners=False)


def other_background(images: Tensor) -> Tensor:
    """Return images some of whose backgrounds are another image, or one colour."""
    count = len(images)
    rgb, mask = images[:, :3], images[:, 3:]
    other = images[torch.randperm(count), :3].flip(3)
    plain = torch.rand(count, 3, 1, 1) + 0.1 * torch.randn(count, 3, HEIGHT_PX, WIDTH_PX)
    other = torch.where(chance(count, 0.4), plain.clamp(0, 1), other)
    mixed = mask * rgb + (1 - mask) * other
    return torch.cat([torch.where(chance(count, 0.4), mixed, rgb), mask], 1)


def occluded(images: Tensor) -> Tensor:
    """Return images, in some of which a part of another image covers a rectangle."""
    count = len(images)
    v = torch.arange(HEIGHT_PX).view(1, 1, -1, 1) / HEIGHT_PX
    u = torch.arange(WIDTH_PX).view(1, 1, 1, -1) / WIDTH_PX
    hidden = (v - uniform(count, 0, 1)).abs() < uniform(count, 0.05, 0.3)
    hidden = hidden & ((u - uniform(count, -0.2, 1.2)).abs() < uniform(count, 0.1, 0.5))
    hidden = hidden & chance(count, 0.3)
    other = images[torch.randperm(count)].clone()
    other[:, 3] = 0
    return torch.where(hidden, other, images)


def lit(rgb: Tensor) -> Tensor:
    """Return images in other light: exposure, white balance, gradients, glare, tone, saturation."""
    count = len(rgb)
    light = rgb.clamp(0, 1) ** 2.2
    v = torch.linspace(-1, 1, HEIGHT_PX).view(1, 1, -1, 1)
    u = torch.linspace(-1, 1, WIDTH_PX).view(1, 1, 1, -1)
    gain = torch.randn(count, 1, 1, 1) * 0.4 + torch.randn(count, 3, 1, 1) * 0.07
    gain = gain + v * torch.randn(count, 1, 1, 1) * 0.25 + u * torch.randn(count, 1, 1, 1) * 0.2
    light = light * torch.exp(gain) + uniform(count, -0.02, 0.03)
    grey = light.mean(1, keepdim=True)
    light = (grey + uniform(count, 0.75, 1.7) * (light - grey)).clamp(0, 1)
    return light ** (uniform(count, 0.75, 1.5) / 2.2)


def blurred(rgb: Tensor) -> Tensor:
    """Return images some of which are blurred, with noise."""
    count = len(rgb)
    soft = functional.avg_pool2d(rgb, 3, 1, 1, count_include_pad=False)
    coarse = functional.interpolate(functional.avg_pool2d(rgb, 2), scale_factor=2.0)
    rgb = torch.where(chance(count, 0.25), soft, rgb)
    rgb = torch.where(chance(count, 0.2), coarse, rgb)
    return (rgb + torch.randn_like(rgb) * uniform(count, 0, 0.04)).clamp(0, 1)


def used_mask(mask: Tensor) -> Tensor:
    """Return masks as a depth layer gives them; all ones where there is none."""
    count = len(mask)
    grown = functional.max_pool2d(mask, 3, 1, 1)
    shrunk = 1 - functional.max_pool2d(1 - mask, 3, 1, 1)
    mask = torch.where(chance(count, 0.3), grown, mask)
    mask = torch.where(chance(count, 0.3), shrunk, mask)
    shift = int(torch.randint(-2, 3, (1,)))
    mask = torch.where(chance(count, 0.5), mask.roll(shift, 3), mask)
    holes = functional.interpolate(
        torch.rand(count, 1, HEIGHT_PX // 6, WIDTH_PX // 6), scale_factor=6.0
    )
    mask = torch.where(chance(count, 0.3) & (holes < 0.1), torch.zeros(1), mask)
    return torch.where(chance(count, 0.7), (mask > 0.5).float(), torch.ones(1))
