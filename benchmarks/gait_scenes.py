"""Render the scenes of `benchmarks.gait_bodies` with another simulator, from seeds.

The simulator is a folder with the modules `simproto`, `scene` and `people`, the bodies
`chars/*.npz` and the recorded cycle of walking `humanoid3d_walk.txt` (of the package pybullet
3.2.7). It is no part of this repository. Bodies a and c are in the scenes `choose_...`, b, d and e
in the scenes `judge_...`. Each scene becomes a folder with `rgb/*.jpg`, `depth/*.png` and `gt.npz`
(see docs/cameras/truth.md). One frame takes about half a second.
"""

import argparse
import dataclasses
import importlib
import math
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from benchmarks.lib.gait.drawn_scenes import draw_scene, drawn_scenes
from benchmarks.lib.gait.other_walkers import (
    OtherWalker,
    Scene,
    Simulator,
    Style,
    ellipse,
    rotation,
)
from benchmarks.lib.gait.styles import STYLE_SCENES, TO_AND_FRO
from people4d.messages import F64, U8, U16

CAMERA_X_M, MIDDLE_X_M, MIDDLE_Z_M = -0.3, 3.6, 0.85
VISIBLE_M = 0.16  # Maximum distance of the surface before a visible joint [m], as in data/lab
TORSO = [5, 6, 11, 12]  # shoulders and hips
BACK = math.pi

AHEAD, BACKWARD = ((3.0, 0.1), (99.0, 0.1)), ((3.4, -0.1), (-99.0, -0.1))
# Path with one round, a stop, a turn on the spot, and the way back
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
    **STYLE_SCENES,
}


def load_simulator(folder: Path) -> Simulator:
    """Import the simulator from its folder, which becomes the working folder for its files."""
    os.chdir(folder)
    sys.path.insert(0, str(folder))
    bodies, stage, wardrobe = map(importlib.import_module, ("simproto", "scene", "people"))
    return Simulator(bodies, stage, wardrobe)


def render(simulator: Simulator, scene: Scene, seed: int, out: Path) -> None:
    """Render a scene into a folder, which appears when it is complete."""
    bodies, stage = simulator.bodies, simulator.stage
    for module in (bodies, stage):
        part = 2 if scene.halved else 1
        module.W, module.H, module.CX, module.CY = (n // part for n in (640, 480, 320, 240))
        module.FX = module.FY = 615.0 / part
    stage.ROOM = stage.room(Wd=scene.width_m)
    rng = np.random.default_rng(seed)
    people = [OtherWalker(simulator, style, seed + k) for k, style in enumerate(scene.people)]
    renderer = stage.Renderer(1)
    pitch = math.atan2(MIDDLE_Z_M - scene.height_m, MIDDLE_X_M - CAMERA_X_M)
    mount: F64 = stage.look((CAMERA_X_M, 0.0, scene.height_m), 0.0, pitch)
    times_s = np.arange(round(scene.seconds * scene.fps)) / scene.fps
    robot_m = np.outer(scene.robot_mps * times_s, (1.0, 0.0, 0.0))
    base = scene.drive.poses(times_s) if scene.drive else np.zeros((len(times_s), 3))
    new = out.with_name(f"{out.name}.new")
    for kind in ("rgb", "depth"):
        (new / kind).mkdir(parents=True, exist_ok=True)
    records = list[FrameTruth]()
    for index, moved_m in enumerate(robot_m):
        for person in people:
            person.walk.advance(1 / scene.fps)
        camera = mount @ np.linalg.inv(_on_ground(base[index]))
        image, depth_mm, record = _frame(simulator, renderer, people, camera, moved_m, rng, scene)
        records.append(record)
        cv2.imwrite(str(new / f"rgb/{index:05d}.jpg"), image, [cv2.IMWRITE_JPEG_QUALITY, 90])
        cv2.imwrite(str(new / f"depth/{index:05d}.png"), depth_mm)
    optical = np.linalg.inv(np.vstack([mount, (0.0, 0.0, 0.0, 1.0)]))
    poses = np.array([_on_ground(pose) @ optical for pose in base])
    poses[:, :3, 3] += robot_m
    arrays: dict[str, Any] = {f: np.array([vars(one)[f] for one in records]) for f in FIELDS}
    if scene.drive:
        arrays["odom"] = scene.drive.odometry(base, rng)
    elif scene.robot_mps:
        arrays["odom"] = robot_m * (1.0, 0.0, 0.0)
    np.savez_compressed(
        new / "gt.npz",
        t=times_s,
        K=np.array([bodies.FX, bodies.FY, bodies.CX, bodies.CY]),
        T_world_cam=poses,
        **arrays,
    )
    new.rename(out)


@dataclass
class FrameTruth:
    """Truth of one frame: arrays with one row for each person, see docs/cameras/truth.md."""

    pos: F64
    vel: F64
    yaw: F64
    path_yaw: F64
    vis: F64
    kp3d: F64
    kp2d: F64
    kpvis: npt.NDArray[np.bool_]


FIELDS = tuple(field.name for field in dataclasses.fields(FrameTruth))


def _frame(
    simulator: Simulator,
    renderer: Any,
    people: Sequence[OtherWalker],
    camera: F64,
    moved_m: F64,
    rng: np.random.Generator,
    scene: Scene,
) -> tuple[U8, U16, FrameTruth]:
    """Return image (BGR), depth and truth; the room, 5 m long, moves along by `moved_m`."""
    bodies, stage = simulator.bodies, simulator.stage
    meshes, matrices = list[Any](), list[F64]()
    bodily, joints, yaws = list[int](), list[F64](), list[float]()
    for person in people:
        found, joint_m, yaw_rad = person.pose()
        bodily.append(len(meshes) + 1)
        meshes += person.meshes()
        matrices += [_moved(matrix, -moved_m) for matrix in found]
        joints.append(joint_m)
        yaws.append(yaw_rad)
    light, depth_m, ids, right_m, (points, faces, owners) = renderer.render(
        meshes, matrices, camera
    )
    kp3d = np.array(joints)
    local = (kp3d - moved_m) @ camera[:, :3].T + camera[:, 3]
    kp2d = local[..., :2] / local[..., 2:] * bodies.FX + (bodies.CX, bodies.CY)
    walks = [person.walk for person in people]
    speeds = [
        (w.speed_mps * math.cos(w.yaw_rad), w.speed_mps * math.sin(w.yaw_rad), 0.0) for w in walks
    ]
    shares = []
    for number in bodily:
        lens = (bodies.FX, bodies.FY, bodies.CX, bodies.CY, bodies.W, bodies.H)
        alone = bodies.raster(points, faces[owners == number], *lens, False, 2)[1] >= 0
        shares.append(float((ids == number).sum() / max(1, alone.sum())))
    record = FrameTruth(
        pos=kp3d[:, TORSO].mean(axis=1),
        vel=np.array(speeds),
        yaw=np.array(yaws),
        path_yaw=np.array([walk.yaw_rad for walk in walks]),
        vis=np.array(shares),
        kp3d=kp3d.astype(np.float32),
        kp2d=kp2d.astype(np.float32),
        kpvis=visible_joints(kp2d, local[..., 2], depth_m),
    )
    image = stage.camera_rgb(light, rng, exposure=scene.exposure)[..., ::-1]
    depth_mm = stage.depth_sensor(depth_m, ids, right_m, rng, fx=bodies.FX)
    return image, depth_mm, record


def _on_ground(pose: F64) -> F64:
    """Return a pose on the ground (x, y, yaw) as 4x4."""
    matrix = np.eye(4)
    matrix[:2, :2], matrix[:2, 3] = rotation(pose[2]), pose[:2]
    return matrix


def _moved(matrices: F64, offset_m: F64) -> F64:
    """Return poses (...x3x4) moved by an offset."""
    moved = matrices.copy()
    moved[..., 3] += offset_m
    return moved


def visible_joints(pixels: F64, joint_depth_m: F64, depth_m: F64) -> npt.NDArray[np.bool_]:
    """Return the joints in the image that no surface far in front of them hides."""
    at = np.round(pixels).astype(int)
    size = depth_m.shape[::-1]
    inside = ((at >= 0) & (at < size)).all(axis=-1) & (joint_depth_m > 0.1)
    column, row = (np.clip(at[..., k], 0, size[k] - 1) for k in range(2))
    return np.asarray(inside & (depth_m[row, column] > joint_depth_m - VISIBLE_M))


def main() -> None:
    """Render the scenes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("simulator", type=Path, help="folder of the other simulator")
    parser.add_argument("out", type=Path, help="folder for the scenes")
    parser.add_argument("--scene", action="append", choices=list(SCENES), help="default: all")
    parser.add_argument("--test", action="store_true", help="scenes of the ablation's test split")
    arguments = parser.parse_args()
    out = arguments.out.resolve()
    simulator = load_simulator(arguments.simulator.resolve())
    wanted = {name: 100 * (1 + list(SCENES).index(name)) for name in arguments.scene or SCENES}
    for name, seed in drawn_scenes() if arguments.test else wanted.items():
        if not (out / name).exists():
            render(
                simulator, draw_scene(name) if arguments.test else SCENES[name], seed, out / name
            )
        print(out / name, flush=True)


if __name__ == "__main__":
    main()
