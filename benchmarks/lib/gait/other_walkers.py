"""Walking people of the other simulator in several styles, and their scenes."""

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from common.geometry.transforms import wrap
from people4d.messages import F64

STEP_S = 1 / 120  # Maximum step of the simulation [s]
PASSED_M, REACHED_M = 0.3, 0.06
TURN_RADPS, TURN_RADPS2 = 2.4, 9.0
FASTER_MPS2, SLOWER_MPS2 = 1.4, 1.8
TURN_CYCLES = 0.22  # Cycles of walking for each radian turned on the spot
LEGS = ("rhip", "rknee", "rankle", "lhip", "lknee", "lankle", "root")
MATERIALS = {"shirt": 2, "trousers": 3}  # numbers of the bones in the simulator
BOX_M = (0.30, 0.40, 0.24)  # carried: depth, width, height
BOX_AHEAD_M = 0.12  # Distance of the middle of the box ahead of the hands [m]
LANDING = 0.94  # Phase of the landing of the left foot
SMOOTH_S = 0.12  # Time constant between standing and walking [s]

Wave = tuple[float, float, float]  # amplitude [m or rad], rate [rad/s], phase [rad]
Waypoint = tuple[float, ...]  # x_m, y_m, and at a stop: seconds and yaw_rad while there


@dataclass(frozen=True)
class Style:
    """A person and their walk."""

    body: str  # name of the body in the simulator
    path: tuple[Waypoint, ...]  # waypoints, repeated
    speed_mps: float = 0.9
    stride: float = 1.0  # factor of the recorded amplitude of the legs
    limp: float = 0.0  # (left - right) / mean of step times
    lean_rad: float = 0.0  # [rad] forward lean of the torso
    arms: str = "swing"  # kind of arm motion: swing, pockets or carry
    skirt: bool = False
    size: tuple[float, float] = (1.0, 1.0)  # width and height relative to the body's
    clothes: Mapping[str, Any] = field(default_factory=dict)  # clothes that replace the body's own


@dataclass(frozen=True)
class Scene:
    """People before a camera."""

    people: tuple[Style, ...]
    seconds: float = 12.0
    fps: float = 20.0
    height_m: float = 1.15  # [m] height of the camera
    robot_mps: float = 0.0  # speed of a camera that follows a person or drives ahead of them
    drive: "Drive | None" = None  # motion of the camera within the room
    width_m: float = 3.5  # [m] width of the room
    exposure: float = 1.0  # exposure of the colour image
    halved: bool = False  # images of half the width and height


@dataclass(frozen=True)
class Drive:
    """Motion of a base that carries the camera; each coordinate is a wave that starts at 0."""

    x: Wave
    y: Wave
    yaw: Wave
    scale: tuple[float, float] = (1.0, 1.0)  # factors of reported distances and turns of odometry
    gyro_rad: float = 0.0004  # standard deviation of a reported turn

    def poses(self, times_s: F64) -> F64:
        """Return x [m], y [m] and yaw [rad] at each time, Nx3."""
        waves = np.array((self.x, self.y, self.yaw))
        start, phase = np.sin(waves[:, 2]), np.outer(times_s, waves[:, 1]) + waves[:, 2]
        return np.asarray(waves[:, 0] * (np.sin(phase) - start))

    def odometry(self, poses: F64, rng: np.random.Generator) -> F64:
        """Return the integrated motion (Nx3) as measured by wheels and a gyroscope."""
        found = np.zeros_like(poses)
        for k, (before, after) in enumerate(pairwise(poses)):
            forth_m, side_m = rotation(-before[2]) @ (after - before)[:2] * self.scale[0]
            turn_rad = (after - before)[2] * self.scale[1] + rng.normal(0.0, self.gyro_rad)
            found[k + 1, :2] = found[k, :2] + rotation(found[k, 2]) @ (forth_m, side_m)
            found[k + 1, 2] = found[k, 2] + turn_rad
        return found


def rotation(yaw_rad: float) -> F64:
    """Return the rotation on the ground, 2x2."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array(((c, -s), (s, c)))


@dataclass
class Simulator:
    """Modules of the other simulator, which are not typed."""

    bodies: Any  # simproto
    stage: Any  # scene
    wardrobe: Any  # people
    clip: Any = field(init=False)
    cuts: dict[str, Any] = field(default_factory=dict)  # bodies by clothes without colours

    def __post_init__(self) -> None:
        """Read the recorded cycle of walking."""
        self.clip = self.bodies.Clip("humanoid3d_walk.txt")

    def dress(self, body: str, clothes: Mapping[str, Any]) -> Any:
        """Return a body in clothes; one cut takes seconds, its colours are exchanged."""
        key = f"{body} {clothes['sleeve']} {clothes['skirt']}"
        if key not in self.cuts:
            self.cuts[key] = self.bodies.Character(f"chars/{body}.npz", clothes)
        dressed = copy.copy(self.cuts[key])
        dressed.style, dressed.col = clothes, dressed.col.copy()
        for name, material in MATERIALS.items():
            dressed.col[dressed.f[dressed.mat == material]] = clothes[name]
        return dressed


def ellipse(
    x_m: float, y_m: float, radius_x_m: float, radius_y_m: float, *, count: int = 24, at: float = 0
) -> tuple[Waypoint, ...]:
    """Return waypoints round an ellipse, starting at a share of it; a negative count: clockwise."""
    angles = 2 * np.pi * (at + np.arange(abs(count)) / count)
    return tuple(
        (x_m + radius_x_m * math.cos(angle), y_m + radius_y_m * math.sin(angle)) for angle in angles
    )


class _Cycle:
    """The recorded cycle of walking in a style."""

    def __init__(self, simulator: Simulator, style: Style):
        self._simulator, self._style = simulator, style
        self._stand = simulator.bodies.stand_pose(0.0, 0)

    def at(self, phase: float) -> dict[str, F64]:
        """Return rotations of the segments at a phase in cycles."""
        pose: dict[str, F64] = self._simulator.clip.at(phase)
        for name in LEGS:
            pose[name] = self._simulator.bodies.slerp(
                self._stand[name], pose[name], self._style.stride
            )
        return self.upper(pose)

    def upper(self, pose: dict[str, F64]) -> dict[str, F64]:
        """Return a pose with the torso and arms of the style."""
        about, style = self._simulator.bodies.axq, self._style
        pose = {**pose}
        if style.lean_rad:
            pose["chest"] = _multiply(about((0, 0, 1), -style.lean_rad), pose["chest"])
            pose["neck"] = _multiply(about((0, 0, 1), 0.6 * style.lean_rad), pose["neck"])
        for side, sign in (("r", 1.0), ("l", -1.0)):
            if style.arms == "carry":
                pose[side + "sho"] = about((0, 0, 1), 0.15)
                pose[side + "elb"] = about((0, 0, 1), 1.35)
            elif style.arms == "pockets":
                out = about((1, 0, 0), -0.30 * sign)
                pose[side + "sho"] = _multiply(about((0, 0, 1), -0.42), out)
                inwards = about((1, 0, 0), 0.35 * sign)
                pose[side + "elb"] = _multiply(about((0, 0, 1), 0.62), inwards)
        return pose


class Walk:
    """Motion along waypoints, repeated, with limits of acceleration and turning."""

    def __init__(self, style: Style, stride_m: float = 1.25, phase: float = 0.0):
        self.style, self._stride_m, self.phase = style, stride_m, phase
        (self.x_m, self.y_m, *_), following = style.path[0], style.path[1]
        self.yaw_rad = math.atan2(following[1] - self.y_m, following[0] - self.x_m)
        self.speed_mps, self.walking = style.speed_mps, 1.0
        self._turn_radps = self.time_s = self._wait_s = 0.0
        self._face_rad: float | None = None
        self._next = 1

    def advance(self, seconds: float, step_s: float = STEP_S) -> None:
        """Continue the walk in steps of a maximum duration."""
        count = math.ceil(seconds / step_s)
        for _ in range(count):
            self._step(seconds / count)

    def _step(self, dt_s: float) -> None:
        style = self.style
        self.time_s += dt_s
        speed = turn = 0.0
        if self._wait_s > 0:
            self._wait_s -= dt_s
            if self._face_rad is not None:
                turn = float(np.clip(3 * wrap(self._face_rad - self.yaw_rad), -1.8, 1.8))
        else:
            goal = style.path[self._next % len(style.path)]
            dx, dy = goal[0] - self.x_m, goal[1] - self.y_m
            far_m, error = math.hypot(dx, dy), wrap(math.atan2(dy, dx) - self.yaw_rad)
            turn = float(np.clip(3.5 * error, -TURN_RADPS, TURN_RADPS))
            speed = style.speed_mps * math.cos(error) ** 2 if abs(error) < 1.4 else 0.0
            stops = len(goal) > 2
            speed = min(speed, 1.6 * far_m) if stops else speed
            if far_m < (REACHED_M if stops else PASSED_M):
                self._next += 1
                self._wait_s, self._face_rad = goal[2:4] if stops else (0.0, None)
        self.speed_mps += float(
            np.clip(speed - self.speed_mps, -SLOWER_MPS2 * dt_s, FASTER_MPS2 * dt_s)
        )
        change = TURN_RADPS2 * dt_s
        self._turn_radps += float(np.clip(turn - self._turn_radps, -change, change))
        self.yaw_rad = wrap(self.yaw_rad + self._turn_radps * dt_s)
        # A limp: one step takes longer than the other, and the body is slower during it.
        landed = math.tau * (self.phase - LANDING)
        uneven = 1 / (1 + style.limp * math.pi / 4 * math.sin(landed))
        gone_m = self.speed_mps * uneven * dt_s
        self.x_m += gone_m * math.cos(self.yaw_rad)
        self.y_m += gone_m * math.sin(self.yaw_rad)
        on_spot = abs(self._turn_radps) * (1 - min(1.0, self.speed_mps / 0.5))
        self.phase += gone_m / self._stride_m + TURN_CYCLES * on_spot * dt_s
        wanted = min(1.0, self.speed_mps / 0.45 + 0.35 * min(1.0, abs(self._turn_radps) / 1.2))
        self.walking += (wanted - self.walking) * min(1.0, dt_s / SMOOTH_S)


class OtherWalker:
    """Person on waypoints; the phase of the walk is locked to the distance."""

    def __init__(self, simulator: Simulator, style: Style, seed: int):
        bodies, wardrobe = simulator.bodies, simulator.wardrobe
        clothes = {**wardrobe.STYLES[style.body], **style.clothes, "skirt": style.skirt}
        self._character = simulator.dress(style.body, clothes)
        scale = np.array((style.size[0], style.size[0], style.size[1]))
        for name in ("v0", "kv0", "heads"):
            vars(self._character)[name] = vars(self._character)[name] * scale
        self._simulator, self._seed = simulator, seed
        self._cycle = _Cycle(simulator, style)
        recorded_m, _ = bodies.calibrate_stride(self._character, simulator.clip)
        phase = float(np.random.default_rng(seed).random())
        self.walk = Walk(style, style.stride * float(recorded_m), phase)
        self._box = _Box(style) if style.arms == "carry" else None

    def pose(self) -> tuple[list[F64], F64, float]:
        """Return the matrices of each mesh of `meshes`, the joints (17x3) and the chest's yaw."""
        bodies, walk = self._simulator.bodies, self.walk
        standing = self._cycle.upper(bodies.stand_pose(walk.time_s, self._seed))
        walking = self._cycle.at(walk.phase)
        share = walk.walking**2 * (3 - 2 * walk.walking)
        mixed = {name: bodies.slerp(standing[name], walking[name], share) for name in standing}
        matrices, chest = self._character.pose(mixed, (walk.x_m, walk.y_m), walk.yaw_rad)
        joints_m: F64 = self._character.kps(matrices)
        found = [matrices]
        if self._box is not None:
            hands_m = joints_m[9:11].mean(axis=0)
            ahead = np.array((math.cos(walk.yaw_rad), math.sin(walk.yaw_rad), 0.0))
            found.append(self._box.matrix(hands_m + BOX_AHEAD_M * ahead, walk.yaw_rad))
        return found, joints_m, math.atan2(-chest[1, 1], -chest[0, 1])

    def meshes(self) -> list[Any]:
        """Return the meshes of the person and of carried objects."""
        return [self._character, *([self._box] if self._box else [])]


class _Box:
    """A carried box, with the attributes by which the simulator draws a person."""

    def __init__(self, style: Style):
        corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
        sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
        self.f = np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))], np.int32)
        # Each triangle has its own vertices, so normals are normals of the sides.
        self.v0 = (corners * np.array(BOX_M) / 2)[self.f.ravel()]
        self.f = np.arange(len(self.v0), dtype=np.int32).reshape(-1, 3)
        self.attr = (self.v0 + 1.0).astype(np.float32)
        self.col = np.tile(np.array((0.30, 0.20, 0.11), np.float32), (len(self.v0), 1))
        self.mat = np.full(len(self.f), 16, np.int32)
        self.style = {"pattern": 0, "carried_by": style.body}

    @staticmethod
    def matrix(middle_m: F64, yaw_rad: float) -> F64:
        """Return the pose as 3x4."""
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        return np.column_stack([np.array(((c, -s, 0), (s, c, 0), (0, 0, 1.0))), middle_m])

    def verts(self, pose: F64) -> F64:
        """Return the vertices in the frame of the room."""
        return np.asarray(self.v0 @ pose[:, :3].T + pose[:, 3])


def _multiply(a: F64, b: F64) -> F64:
    """Return the product of two quaternions, wxyz."""
    vector = a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
    return np.concatenate([[a[0] * b[0] - a[1:] @ b[1:]], vector])
