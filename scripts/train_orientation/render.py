"""Render upper bodies of people of the lab, who look like no one of its cast, with their yaws.

`python -m scripts.train_orientation.render OUT` writes NNN.npz with crops (NxHxWx6 bytes), owners
(N) and yaws_rad (N); the scenes are those of `scripts.train_embedding.render`.
"""

from collections.abc import Iterator

import cv2
import numpy as np

from people4d.messages import HIDDEN_RGB, U8
from scripts.train_embedding.outfits import Rng
from scripts.train_embedding.render import (
    DARK_SCENES,
    PEOPLE,
    PIXELS_MIN,
    PersonView,
    Stage,
    draw_identity,
    draw_image,
    write_parts,
)

SIZE_PX = (96, 72)  # height and width of stored crops
SIZE_M = (1.65, 1.24)  # of the world at the person's depth
ABOVE_M = 0.75  # of it above the shoulders
OUTSIDE = (*HIDDEN_RGB, 0, 255, 0)  # what lies out of the image


def upper_body(rgb: U8, view: PersonView, fx: float) -> U8 | None:
    """Return the crop around the shoulders, HxWx6; None if too little of the person is visible."""
    if np.count_nonzero(view.own) < PIXELS_MIN:
        return None
    planes = [plane * np.uint8(255) for plane in (view.own, view.hidden, view.layer)]
    image = np.dstack([rgb, *planes])
    px_per_m = fx / view.depth_m
    size = np.array(SIZE_M) * px_per_m
    corner = view.shoulders_px[::-1] - (ABOVE_M * px_per_m, size[1] / 2)
    low = np.rint(corner).astype(int)
    high = np.maximum(np.rint(corner + size).astype(int), low + 4)
    inside_low, inside_high = np.clip(low, 0, image.shape[:2]), np.clip(high, 0, image.shape[:2])
    if (inside_high <= inside_low).any():
        return None
    window = np.empty((*(high - low), 6), np.uint8)
    window[:] = OUTSIDE
    at, to = inside_low - low, inside_high - low
    part = image[inside_low[0] : inside_high[0], inside_low[1] : inside_high[1]]
    window[at[0] : to[0], at[1] : to[1]] = part
    if not window[..., 3].any():
        return None
    halves = [
        cv2.resize(np.ascontiguousarray(half), SIZE_PX[::-1], interpolation=cv2.INTER_AREA)
        for half in (window[..., :3], window[..., 3:])
    ]
    return np.dstack(halves)


def crops_of_scene(rng: Rng, stage: Stage, views: int) -> Iterator[tuple[int, U8, float]]:
    """Yield the crops of one scene: number of the person, HxWx6, yaw in rad."""
    dark = bool(rng.random() < DARK_SCENES)
    people = [draw_identity(rng, stage, dark) for _ in range(PEOPLE)]
    for _ in range(views):
        room = int(rng.integers(len(stage.rooms)))
        rgb, person_views = draw_image(rng, stage, people, room)
        for k, view in person_views.items():
            crop = upper_body(rgb, view, stage.rooms[room][1].info.fx)
            if crop is not None:
                yield k, crop, view.yaw_rad


if __name__ == "__main__":
    write_parts(__doc__.splitlines()[0], crops_of_scene)
