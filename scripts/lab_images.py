"""Draw the images of docs/cameras/lab.md: `python -m scripts.lab_images`."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from common.drawing.tiles import Tile, grid, shrink
from lab.camera.frames import FrameRenderer, RenderSettings
from lab.catalogue import load_scenario
from lab.output.preview import Preview, depth_image
from lab.world import World
from people4d.messages import U8

FOLDER = Path(__file__).parents[1] / "docs" / "pictures"
JPEG = [cv2.IMWRITE_JPEG_QUALITY, 85]
ROOMS = ("two_easy", "port1")  # a scenario of each room, drawn with three seeds
SCENARIOS = (  # share of the scenario's time
    ("two_crossing", 0.16),
    ("three_dense", 0.22),
    ("four_dense", 0.10),
    ("twins", 0.6),
    ("short_sit", 0.50),
    ("pmrm2", 0.30),
)

HARD = (
    ("aisle", 0.12),
    ("aisle", 0.55),
    ("random?seed=2&view=head", 0.4),
    ("random?seed=1&view=ceiling&people=6", 0.13),
)


def main() -> None:
    """Draw all images."""
    write("lab-cast", [still("cast", 0.0)], 1, 1200)
    write("lab-rooms", [still(name, 0.5, seed) for name in ROOMS for seed in (1, 2, 3)], 3, 480)
    write("lab-truth", [explained("crossing", share) for share in (0.2, 0.85)], 2, 800)
    write("lab-scenarios", [still(name, share) for name, share in SCENARIOS], 3, 480)
    write("lab-hard", [measured(name, share) for name, share in HARD], 2, 800)


def still(name: str, share: float, seed: int | None = None) -> Tile:
    """Return the colour image at a share of a scenario's time."""
    renderer, index = prepare(name, share, seed)
    caption = name if seed is None else f"{renderer.world.scenario.room}, seed {seed}"
    return Tile(renderer.rgb(index, renderer.view(index)), caption)


def explained(name: str, share: float) -> Tile:
    """Return an image with its truth beside depth, masks and map."""
    renderer, index = prepare(name, share, None)
    return Tile(Preview(renderer).image(index), f"{renderer.world.frame_s(index):.1f} s")


def measured(name: str, share: float) -> Tile:
    """Return a colour image beside the depth that the sensor reads."""
    renderer, index = prepare(name, share, None)
    view, far_m = renderer.view(index), renderer.world.info.max_depth_m
    depth = depth_image(renderer.depth_mm(index, view), far_m)
    return Tile(np.hstack([renderer.rgb(index, view), depth]), name)


def prepare(name: str, share: float, seed: int | None) -> tuple[FrameRenderer, int]:
    """Return a renderer and the index of a frame at a share of its time."""
    renderer = FrameRenderer(World(load_scenario(name), seed), RenderSettings(samples=2, threads=2))
    return renderer, int(share * (renderer.world.frame_count - 1))


def write(name: str, tiles: Sequence[Tile], columns: int, width: int) -> None:
    """Write images side by side, each so many pixels wide."""
    page: U8 = grid([Tile(shrink(t.image, width), t.caption) for t in tiles], columns)
    path = FOLDER / f"{name}.jpg"
    path.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(path), cv2.cvtColor(page, cv2.COLOR_RGB2BGR), JPEG)
    print(path.name, path.stat().st_size, "bytes")


if __name__ == "__main__":
    main()
