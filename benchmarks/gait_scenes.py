"""Render the scenes of `benchmarks.gait_bodies` with another simulator, from seeds.

The simulator is a folder with the modules `simproto`, `scene` and `people`, the bodies
`chars/*.npz` and the recorded cycle of walking `humanoid3d_walk.txt` (of the package pybullet
3.2.7). It is no part of this repository. Bodies a and c are in the scenes `choose_...`, b, d and e
in the scenes `judge_...`. Each scene becomes a folder with `rgb/*.jpg`, `depth/*.png` and `gt.npz`
(see docs/cameras/truth.md). One frame takes about half a second.
"""

import argparse
import importlib
import math
import os
import sys
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from benchmarks.lib.gait.other_walkers import OtherWalker, Scene, Simulator, Style, ellipse
from people4d.messages import F64

CAMERA_X_M, MIDDLE_X_M, MIDDLE_Z_M = -0.3, 3.6, 0.85
VISIBLE_M = 0.16  # by which a surface may be before a joint that is visible, as in data/lab
SIZE_PX = (640, 480)
BACK = math.pi

AHEAD, BACKWARD = ((3.0, 0.1), (99.0, 0.1)), ((3.4, -0.1), (-99.0, -0.1))
TO_AND_FRO = ((2.8, -0.8), (4.7, -0.9))
# Round once, a stop, a turn on the spot and back
TURNS = (*ellipse(3.6, 0.55, 0.8, 0.5), (4.4, 0.55, 2.0, -math.pi / 2))
SCENES = {
    "choose_1": Scene(
        (
            Style("a", ellipse(3.6, -0.5, 0.8, 0.55), limp=0.2),
            Style("c", ellipse(3.7, 0.6, 0.7, 0.5, count=-24, at=0.5), arms="pockets"),
        )
    ),
    "choose_2": Scene(
        (
            Style(
                "a",
                ellipse(3.6, -0.5, 0.8, 0.6, count=-24),
                0.5,
                0.65,
                lean_rad=0.35,
                size=(1.05, 0.93),
            ),
            Style("c", ellipse(3.7, 0.65, 0.8, 0.5, at=0.3), 0.9, arms="carry"),
        ),
        seconds=10.0,
        fps=30.0,
        height_m=0.6,
    ),
    "choose_turns": Scene(
        (
            Style("a", TURNS, 0.95),
            Style("c", TO_AND_FRO, 0.85),
        ),
        seconds=20.0,
        fps=15.0,
        height_m=1.6,
    ),
    "choose_limp_20": Scene((Style("c", AHEAD, limp=-0.2),), 40.0, 12.0, 1.0, 0.9),
    "choose_limp_10": Scene((Style("a", BACKWARD, limp=0.1),), 45.0, 12.0, 1.3, -0.9),
    "judge_1": Scene(
        (
            Style("b", ellipse(3.6, -0.55, 0.8, 0.55), 0.45, 0.6, lean_rad=0.4, size=(1.0, 0.95)),
            Style("d", ellipse(3.7, 0.5, 0.9, 0.7, count=-24, at=0.5), 1.35, 1.1),
        ),
        height_m=2.0,
    ),
    "judge_2": Scene(
        (
            Style("e", ellipse(3.6, -0.6, 0.8, 0.5, count=-24), arms="pockets", size=(0.97, 1.03)),
            Style("b", ellipse(3.7, 0.5, 0.8, 0.6, at=0.5), 0.85, limp=-0.2),
        ),
        fps=15.0,
        height_m=0.5,
    ),
    "judge_3": Scene(
        (
            Style("b", ellipse(3.6, -0.5, 0.8, 0.6), limp=0.1),
            Style("d", ellipse(3.7, 0.6, 0.8, 0.55, count=-24, at=0.4), 0.8, skirt=True),
        ),
        seconds=10.0,
        fps=30.0,
        height_m=1.0,
    ),
    "judge_4": Scene(
        (
            Style("b", (*ellipse(3.1, -0.9, 0.4, 0.4), (3.5, -0.9, 2.0, BACK)), 0.7),
            Style("d", ellipse(3.6, 0.75, 0.8, 0.45, count=-24, at=0.2), arms="carry"),
            Style("e", ellipse(4.4, -0.3, 0.4, 0.9, at=0.6), 1.0, size=(0.95, 0.97)),
        ),
        height_m=1.4,
    ),
    "judge_turns": Scene(
        (
            Style("b", TURNS, 0.9),
            Style("e", TO_AND_FRO, 0.95),
        ),
        seconds=16.0,
        fps=20.0,
        height_m=1.2,
    ),
    "judge_limp_20": Scene((Style("e", BACKWARD, limp=0.2),), 40.0, 12.0, 1.0, -0.9),
    "judge_limp_10": Scene((Style("b", AHEAD, limp=-0.1),), 45.0, 12.0, 1.3, 0.9),
    "judge_even": Scene((Style("d", BACKWARD),), 40.0, 12.0, 0.8, -0.9),
    "choose_circles": Scene(
        (
            Style("a", (*ellipse(3.2, 0.85, 0.4, 0.4, count=-24), (3.6, 0.85, 1.5, 0.0)), 0.75),
            Style("c", ellipse(3.6, -0.7, 0.8, 0.45, at=0.6), arms="carry"),
            Style("a", ellipse(4.4, 0.2, 0.4, 0.9, at=0.1), 0.95, size=(0.95, 0.97)),
        ),
        height_m=1.3,
    ),
}


def load_simulator(folder: Path) -> Simulator:
    """Import the simulator from its folder, and go there: it reads its files by relative paths."""
    os.chdir(folder)
    sys.path.insert(0, str(folder))
    return Simulator(*(importlib.import_module(name) for name in ("simproto", "scene", "people")))


def render(simulator: Simulator, name: str, out: Path) -> None:
    """Render a scene into a folder."""
    bodies, stage, scene = simulator.bodies, simulator.stage, SCENES[name]
    seed = 100 * (1 + list(SCENES).index(name))
    rng = np.random.default_rng(seed)
    people = [OtherWalker(simulator, style, seed + k) for k, style in enumerate(scene.people)]
    renderer = stage.Renderer(1)
    pitch = math.atan2(MIDDLE_Z_M - scene.height_m, MIDDLE_X_M - CAMERA_X_M)
    camera: F64 = stage.look((CAMERA_X_M, 0.0, scene.height_m), 0.0, pitch)
    times_s = np.arange(round(scene.seconds * scene.fps)) / scene.fps
    robot_m = np.outer(scene.robot_mps * times_s, (1.0, 0.0, 0.0))
    for kind in ("rgb", "depth"):
        (out / kind).mkdir(parents=True, exist_ok=True)
    joints, pixels, visible = [], [], []
    for index, moved_m in enumerate(robot_m):
        meshes, matrices, joints_m = [], [], []
        for person in people:
            person.advance(1 / scene.fps)
            found, joint_m = person.pose()
            meshes += person.meshes()
            # The room moves along: the simulator's is 5 m long.
            matrices += [_moved(matrix, -moved_m) for matrix in found]
            joints_m.append(joint_m)
        image, depth_m, ids, right_m, _ = renderer.render(meshes, matrices, camera)
        joints.append(np.array(joints_m))
        local = (joints[-1] - moved_m) @ camera[:, :3].T + camera[:, 3]
        pixels.append(local[..., :2] / local[..., 2:] * bodies.FX + (bodies.CX, bodies.CY))
        visible.append(visible_joints(pixels[-1], local[..., 2], depth_m))
        colour = stage.camera_rgb(image, rng)[..., ::-1]
        cv2.imwrite(str(out / f"rgb/{index:05d}.jpg"), colour, [cv2.IMWRITE_JPEG_QUALITY, 90])
        depth_mm = stage.depth_sensor(depth_m, ids, right_m, rng)
        cv2.imwrite(str(out / f"depth/{index:05d}.png"), depth_mm)
    poses = np.tile(np.linalg.inv(np.vstack([camera, (0.0, 0.0, 0.0, 1.0)])), (len(robot_m), 1, 1))
    poses[:, :3, 3] += robot_m
    np.savez_compressed(
        out / "gt.npz",
        t=times_s,
        K=np.array([bodies.FX, bodies.FY, bodies.CX, bodies.CY]),
        T_world_cam=poses,
        odom=robot_m * (1.0, 0.0, 0.0),
        kp3d=np.array(joints, np.float32),
        kp2d=np.array(pixels, np.float32),
        kpvis=np.array(visible),
    )


def _moved(matrices: F64, offset_m: F64) -> F64:
    """Return poses (...x3x4) moved by an offset."""
    moved = matrices.copy()
    moved[..., 3] += offset_m
    return moved


def visible_joints(pixels: F64, joint_depth_m: F64, depth_m: F64) -> npt.NDArray[np.bool_]:
    """Return the joints in the image with no surface far before them."""
    at = np.round(pixels).astype(int)
    inside = ((at >= 0) & (at < SIZE_PX)).all(axis=-1) & (joint_depth_m > 0.1)
    column, row = (np.clip(at[..., k], 0, SIZE_PX[k] - 1) for k in range(2))
    return np.asarray(inside & (depth_m[row, column] > joint_depth_m - VISIBLE_M))


def main() -> None:
    """Render the scenes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("simulator", type=Path, help="folder of the other simulator")
    parser.add_argument("out", type=Path, help="folder for the scenes")
    parser.add_argument("--scene", action="append", choices=list(SCENES), help="default: all")
    arguments = parser.parse_args()
    out = arguments.out.resolve()
    simulator = load_simulator(arguments.simulator.resolve())
    for name in arguments.scene or SCENES:
        render(simulator, name, out / name)
        print(out / name, flush=True)


if __name__ == "__main__":
    main()
