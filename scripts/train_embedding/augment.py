"""Augmentation of crops, against overfitting to renderings."""

import torch  # type: ignore[import-not-found]
from torch import Tensor
from torch.nn import functional  # type: ignore[import-not-found]

from scripts.train_embedding.network import HEIGHT_PX, WIDTH_PX

HIDDEN = (124 / 255, 116 / 255, 104 / 255)  # colour of hidden pixels, HIDDEN_RGB of the messages
RGB, OWN, HIDES, LAYER = slice(0, 3), slice(3, 4), slice(4, 5), slice(5, 6)  # channels of crops


def augment(crops: Tensor, people: Tensor, scenes: Tensor) -> Tensor:
    """Return crops as input of the network.

    Args:
        crops: Nx6xHxW bytes, see scripts/render_people.
        people: N numbers from 0, of the person of each crop.
        scenes: N numbers from 0, of the scene of each crop, with similar light.
    """
    images = dyed(moved(crops.float() / 255), people, scenes)
    images = occluded(other_background(images))
    rgb = blurred(lit(images[:, RGB], scenes))
    return with_mask(torch.cat([rgb, images[:, 3:]], 1))


def uniform(count: int, low: float, high: float) -> Tensor:
    """Return Nx1x1x1 random numbers."""
    return torch.empty(count, 1, 1, 1).uniform_(low, high)


def chance(count: int, share: float) -> Tensor:
    """Return flags (Nx1x1x1), true for a random share."""
    return uniform(count, 0, 1) < share


def dyed(images: Tensor, people: Tensor, scenes: Tensor) -> Tensor:
    """Return images with changed colours of some people, the same in all their views.

    In some scenes all clothes are dark.
    """
    count = int(people.max()) + 1
    matrix = torch.eye(3) + 0.25 * torch.randn(count, 3, 3)
    order = torch.rand(count, 3).argsort(1)
    matrix = torch.gather(matrix, 1, order[:, :, None].expand(-1, -1, 3))
    matrix = matrix / matrix.sum(2, keepdim=True).clamp_min(0.3)
    matrix = matrix * torch.exp(0.5 * torch.randn(count, 1, 1))
    matrix = torch.where(torch.rand(count, 1, 1) < 0.5, matrix, torch.eye(3))[people]
    several = int(scenes.max()) + 1
    darker = torch.where(chance(several, 0.2), uniform(several, 0.05, 0.3), torch.ones(1))
    light = torch.einsum("nij,njhw->nihw", matrix, images[:, RGB] ** 2.2) * darker[scenes]
    own = images[:, OWN]
    rgb = own * light.clamp(0, 1) ** (1 / 2.2) + (1 - own) * images[:, RGB]
    return torch.cat([rgb, images[:, 3:]], 1)


def moved(images: Tensor) -> Tensor:
    """Return images with inaccurate boxes, some mirrored, some cut off."""
    count = len(images)
    theta = torch.zeros(count, 2, 3)
    turn = torch.randn(count) * 0.08
    flip = torch.where(torch.rand(count) < 0.5, -1.0, 1.0)
    scale = torch.exp(torch.randn(count, 2) * 0.1)
    theta[:, 0, 0], theta[:, 1, 1] = flip * scale[:, 0], scale[:, 1]
    theta[:, 0, 1], theta[:, 1, 0] = turn, -turn
    theta[:, :, 2] = torch.randn(count, 2) * 0.1
    # Boxes cut at the bottom, as by a desk, or at the sides, as by the image's edge
    low, side = (
        torch.where(
            torch.rand(count) < share, torch.empty(count).uniform_(least, 0.9), torch.ones(1)
        )
        for share, least in ((0.25, 0.35), (0.12, 0.4))
    )
    theta[:, 1, 2] += low - 1
    theta[:, 1, 1] *= low
    theta[:, 0, 2] += (1 - side) * torch.where(torch.rand(count) < 0.5, -1.0, 1.0)
    theta[:, 0, 0] *= side
    grid = functional.affine_grid(
        theta, [count, images.shape[1], HEIGHT_PX, WIDTH_PX], align_corners=False
    )
    return functional.grid_sample(images, grid, padding_mode="border", align_corners=False)


def other_background(images: Tensor) -> Tensor:
    """Return images, some with another background or one colour."""
    count = len(images)
    rgb, own = images[:, RGB], images[:, OWN]
    other = images[torch.randperm(count), RGB].flip(3)
    plain = torch.rand(count, 3, 1, 1) + 0.1 * torch.randn_like(rgb)
    other = torch.where(chance(count, 0.4), plain.clamp(0, 1), other)
    mixed = own * rgb + (1 - own) * other
    return torch.cat([torch.where(chance(count, 0.4), mixed, rgb), images[:, 3:]], 1)


def occluded(images: Tensor) -> Tensor:
    """Return images, some partly covered by another person or a rectangle."""
    count = len(images)
    height, width = images.shape[2:]
    v = torch.arange(height).view(1, 1, -1, 1) / height
    u = torch.arange(width).view(1, 1, 1, -1) / width
    rectangle = (v - uniform(count, 0, 1)).abs() < uniform(count, 0.05, 0.3)
    rectangle = rectangle & ((u - uniform(count, -0.2, 1.2)).abs() < uniform(count, 0.1, 0.5))
    # A nearer person, to a side and lower in the image
    other = images[torch.randperm(count)]
    theta = torch.zeros(count, 2, 3)
    theta[:, 0, 0] = torch.empty(count).uniform_(0.5, 1.2)
    theta[:, 1, 1] = torch.empty(count).uniform_(0.5, 1.1)
    theta[:, 0, 2] = torch.empty(count).uniform_(-1.2, 1.2)
    theta[:, 1, 2] = torch.empty(count).uniform_(-1.0, 0.2)
    grid = functional.affine_grid(theta, list(other.shape), align_corners=False)
    other = functional.grid_sample(other, grid, align_corners=False)
    hides = torch.where(chance(count, 0.6), other[:, OWN], rectangle.float())
    hides = hides * chance(count, 0.4)
    rgb = hides * other[:, RGB] + (1 - hides) * images[:, RGB]
    planes = images[:, 3:] * (1 - hides)
    planes[:, 1:2] = torch.maximum(images[:, HIDES], hides)
    return torch.cat([rgb, planes], 1)


def lit(rgb: Tensor, scenes: Tensor) -> Tensor:
    """Return images in other light: exposure, white balance, gradients, glare, tone, saturation.

    Most of the change is common to a scene, as for one camera within minutes.
    """
    count, several = len(rgb), int(scenes.max()) + 1
    light = rgb.clamp(0, 1) ** 2.2
    v = torch.linspace(-1, 1, rgb.shape[2]).view(1, 1, -1, 1)
    u = torch.linspace(-1, 1, rgb.shape[3]).view(1, 1, 1, -1)
    gain = torch.randn(several, 1, 1, 1) * 0.4 + torch.randn(several, 3, 1, 1) * 0.1
    gain = gain[scenes] + torch.randn(count, 1, 1, 1) * 0.25 + torch.randn(count, 3, 1, 1) * 0.05
    gain = gain + v * torch.randn(count, 1, 1, 1) * 0.2 + u * torch.randn(count, 1, 1, 1) * 0.15
    glare = uniform(several, -0.015, 0.025)[scenes] + uniform(count, -0.005, 0.005)
    light = light * torch.exp(gain) + glare
    grey = light.mean(1, keepdim=True)
    saturation = uniform(several, 0.7, 1.7)[scenes] * uniform(count, 0.9, 1.1)
    light = (grey + saturation * (light - grey)).clamp(0, 1)
    return light ** (uniform(several, 0.75, 1.5)[scenes] * uniform(count, 0.93, 1.07) / 2.2)


def blurred(rgb: Tensor) -> Tensor:
    """Return images with noise, some blurred or small."""
    count = len(rgb)
    soft = functional.avg_pool2d(rgb, 3, 1, 1, count_include_pad=False)
    streaked = functional.avg_pool2d(rgb, (1, 5), 1, (0, 2), count_include_pad=False)
    rgb = torch.where(chance(count, 0.2), soft, rgb)
    rgb = torch.where(chance(count, 0.15), streaked, rgb)
    rgb = noisy(rgb, 0.03)
    for factor, share in ((2, 0.25), (3, 0.12)):
        pooled = noisy(functional.avg_pool2d(rgb, factor), 0.03)
        coarse = functional.interpolate(pooled, rgb.shape[2:], mode="bilinear")
        rgb = torch.where(chance(count, share), coarse, rgb)
    return rgb


def noisy(rgb: Tensor, most: float) -> Tensor:
    """Return images with noise of a random standard deviation."""
    return (rgb + torch.randn_like(rgb) * uniform(len(rgb), 0, most)).clamp(0, 1)


def with_mask(images: Tensor) -> Tensor:
    """Return colours and a mask in the form of a detector.

    With a depth image, hidden pixels are blanked and excluded from the mask, in half of the images
    also the far background. Some detectors give a mask of the person; without depth and mask it is
    all ones.
    """
    count = len(images)
    own, hides, layer = images[:, OWN], images[:, HIDES], images[:, LAYER]
    ragged = torch.rand_like(own) * uniform(count, 0, 0.8)
    shift = int(torch.randint(-1, 2, (1,)))
    moved_layer = torch.where(chance(count, 0.4), layer.roll(shift, 3), layer)
    blocks = torch.rand(count, 1, images.shape[2] // 4, images.shape[3] // 4)
    holes = functional.interpolate(blocks, scale_factor=4.0)
    near = torch.maximum(moved_layer + ragged, (holes < uniform(count, 0, 0.3)).float())
    blank = (hides + 0.5 * (ragged - 0.4) > 0.5).float()
    kind = uniform(count, 0, 1)
    mask = torch.where(kind < 0.5, near * (1 - blank), 1 - blank)
    mask = torch.where(kind > 0.85, own, mask)
    mask = torch.where(kind > 0.93, torch.ones(1), mask)
    colour = torch.tensor(HIDDEN).view(1, 3, 1, 1)
    rgb = torch.where((kind < 0.9) & (blank > 0), colour, images[:, RGB])
    return torch.cat([rgb, (mask > 0.5).float()], 1)
