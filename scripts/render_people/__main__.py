"""Render crops of people to train networks: `python -m scripts.render_people OUT`.

It writes NNN.npz with `bodies` (NxHxWx6 bytes) and `owners` (N), and `upper_bodies` (MxHxWx6),
`upper_owners` (M) and `yaws_rad` (M). Needs nothing but the project.
"""

import argparse
import time
from pathlib import Path

import cv2
import numpy as np

from people4d.messages import U8
from scripts.render_people.crops import body, upper_body
from scripts.render_people.views import PEOPLE, make_stage, views_of_scene


def main() -> None:
    """Render and write a file for each part."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="folder to write to")
    parser.add_argument("--parts", type=int, default=14, help="files; each draws its own stage")
    parser.add_argument("--first", type=int, default=0, help="number of the first, and its seed")
    parser.add_argument("--scenes", type=int, default=25, help="of each part")
    parser.add_argument("--images", type=int, default=14, help="of each scene")
    parser.add_argument("--cuts", type=int, default=16, help="bodies in clothes of different cut")
    parser.add_argument("--rooms", type=int, default=8)
    flags = parser.parse_args()
    cv2.setNumThreads(1)
    flags.out.mkdir(parents=True, exist_ok=True)
    for part in range(flags.first, flags.first + flags.parts):
        start_s = time.process_time()
        rng = np.random.default_rng(part)
        stage = make_stage(rng, flags.cuts, flags.rooms)
        bodies, owners = list[U8](), list[int]()
        upper_bodies, upper_owners, yaws_rad = list[U8](), list[int](), list[float]()
        for scene in range(flags.scenes):
            for k, rgb, view in views_of_scene(rng, stage, flags.images):
                if (crop := body(rng, rgb, view)) is not None:
                    bodies.append(crop)
                    owners.append(scene * PEOPLE + k)
                if (crop := upper_body(rgb, view)) is not None:
                    upper_bodies.append(crop)
                    upper_owners.append(scene * PEOPLE + k)
                    yaws_rad.append(view.yaw_rad)
        np.savez(
            flags.out / f"{part:03}.npz",
            bodies=np.stack(bodies),
            owners=np.array(owners),
            upper_bodies=np.stack(upper_bodies),
            upper_owners=np.array(upper_owners),
            yaws_rad=np.array(yaws_rad),
        )
        print(f"{part}: {len(bodies)} crops, {time.process_time() - start_s:.0f} s", flush=True)


if __name__ == "__main__":
    main()
