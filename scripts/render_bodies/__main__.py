"""Render candidates to train the body network: `python -m scripts.render_bodies FOLDER`.

It writes NNN.npz, and CONTENT-NN.npz with detections in furnished rooms, all with the
fields of `Samples`. It continues where it stopped. Needs nothing but the project.
"""

import argparse
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from scripts.render_bodies.candidates import Samples, samples_of_scene
from scripts.render_bodies.detected import CONTENTS, detect_part
from scripts.render_bodies.labels import Kind
from scripts.render_bodies.postures import draw_postures
from scripts.render_people.views import make_stage

SEED = 55  # seed of all parts, with the number of the part
SCENES, IMAGES = 25, 14  # numbers of scenes of a part, and of images of a scene
CUTS, ROOMS = 16, 8  # numbers of bodies in clothes of different cut, and of rooms, of a part
POSTURES_FROM = 36  # first part in which half of the bodies sit, lie, bend, squat or fall
DETECTED = 10  # number of files of detections of each content


def main() -> None:
    """Render and write the missing parts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder to write to")
    parser.add_argument("--parts", type=int, default=48, help="files; each draws its own stage")
    parser.add_argument("--first", type=int, default=0, help="number of the first, and its seed")
    flags = parser.parse_args()
    cv2.setNumThreads(1)
    flags.folder.mkdir(parents=True, exist_ok=True)
    parts = range(flags.first, flags.first + flags.parts)
    files = {f"{part:03}": partial(render_part, part, SCENES, IMAGES) for part in parts}
    for name, content in CONTENTS.items():
        for part in range(DETECTED):
            files[f"{name}-{part:02}"] = partial(detect_part, content, part)
    for name, render in files.items():
        path = flags.folder / f"{name}.npz"
        if path.exists():
            continue
        start_s = time.process_time()
        samples = render()
        written = path.with_suffix(".part")
        with written.open("wb") as file:
            np.savez(file, **samples._asdict())
        written.rename(path)
        print(f"{name}: {counts(samples)}; {time.process_time() - start_s:.0f} s", flush=True)


def render_part(part: int, scenes: int, images: int) -> Samples:
    """Return the samples of some scenes of a part."""
    rng = np.random.default_rng([SEED, part])
    stage = make_stage(rng, CUTS, ROOMS)
    if part >= POSTURES_FROM:
        changed = [draw_postures(rng, body) for body in stage.bodies[: CUTS // 2]]
        stage = replace(stage, motions=[*changed, *stage.motions[len(changed) :]])
    found = [samples for _ in range(scenes) for samples in samples_of_scene(rng, stage, images)]
    return Samples(*map(np.concatenate, zip(*found, strict=True)))


def counts(samples: Samples) -> str:
    """Return the number of samples of each kind."""
    numbers = np.bincount(samples.kinds, minlength=len(Kind))
    parts = (f"{numbers[kind]} {kind.title}" for kind in Kind)
    return f"{len(samples.kinds)} candidates: {', '.join(parts)}"


if __name__ == "__main__":
    main()
