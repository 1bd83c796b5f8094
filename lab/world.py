"""World of a scenario: bodies, motion, room and camera at any time."""

from functools import cached_property

import numpy as np
from msgspec.structs import replace

from common.geometry.transforms import invert
from lab.bodies.body import SkinnedBody, load_body
from lab.bodies.skeleton import BodyPose
from lab.camera.base_path import BasePath
from lab.camera.plan import CameraPlan
from lab.drawing.mesh import Mesh
from lab.drawing.pieces import furnished, moved, wheelchair
from lab.drawing.rooms import Room, room_mesh
from lab.furniture import discs_of
from lab.lookalikes import Lookalike
from lab.motion.motion import PersonMotion, simulate
from lab.scenario import WALKABLE_M, Scenario
from people4d.errors import ConfigError
from people4d.messages import F64, CameraInfo

EPOCH_NS = 1_767_225_600 * 10**9  # start of all scenarios, 2026-01-01 00:00 UTC
CAMERA_KEY = 0xCA3  # key of the random numbers of additional cameras
MAX_DEPTH_M = 5.0  # maximum valid depth [m]; docs/method.md section 1


class World:
    """A scenario as functions of the time since its start.

    Slow parts are computed on first use: poses of the camera need no body, and the truth of people
    needs no room.

    Args:
        scenario: People, room and camera.
        seed: Seed of light, motion and noise; None: the seed of the scenario.
    """

    def __init__(self, scenario: Scenario, seed: int | None = None) -> None:
        self.scenario = scenario
        self.seed = scenario.seed if seed is None else seed
        self.noise_seed = self.seed  # seed of the errors of the camera and its depth
        self.info = camera_info(scenario.camera)
        self._first: World | None = None  # world of the first camera; None: this one

    @cached_property
    def views(self) -> "tuple[World, ...]":
        """Worlds of all cameras, this one first, with common people and room."""
        plans = self.scenario.cameras
        return (self, *(self._view(number, plan) for number, plan in enumerate(plans, 1)))

    def view(self, camera: str) -> "World":
        """Return the world of a camera by its name; empty: the first; or ConfigError."""
        for world in self.views:
            if camera in ("", world.info.camera):
                return world
        names = ", ".join(world.info.camera for world in self.views)
        raise ConfigError(f"the scenario has no camera {camera}", f"It has {names}.")

    def _view(self, number: int, plan: CameraPlan) -> "World":
        world = World(replace(self.scenario, camera=plan, cameras=()), self.seed)
        state = np.random.SeedSequence([self.seed, CAMERA_KEY, number]).generate_state(1)
        world.noise_seed, world._first = int(state[0]), self
        return world

    @cached_property
    def bodies(self) -> tuple[SkinnedBody, ...]:
        """Bodies of the people, in the order of the scenario."""
        if self._first:
            return self._first.bodies
        return tuple(
            load_body(person.body, self.seed, person.outfit, number, person.size)
            for number, person in enumerate(self.scenario.people)
        )

    @cached_property
    def motions(self) -> tuple[PersonMotion, ...]:
        """Motions of the people, in the order of the scenario; they avoid camera and furniture."""
        if self._first:
            return self._first.motions
        scenario = self.scenario
        return simulate(
            scenario.people,
            [body.skeleton for body in self.bodies],
            scenario.duration_s,
            self.seed,
            obstacle=self.path.position if scenario.camera.avoided else None,
            area_m=np.array(WALKABLE_M[scenario.room]),
            discs=[disc for piece in scenario.pieces for disc in discs_of(piece)],
        )

    @cached_property
    def objects(self) -> tuple[Lookalike, ...]:
        """Objects that look like people, in the order of the scenario."""
        plans, duration_s = self.scenario.objects, self.scenario.duration_s
        return tuple(Lookalike(plan, self.seed, k, duration_s) for k, plan in enumerate(plans))

    @cached_property
    def path(self) -> BasePath:
        """Path of the camera and of the robot that carries it."""
        return BasePath(self.scenario.camera, self.scenario.duration_s)

    @cached_property
    def room(self) -> Room:
        """The room, with its furniture and a stool for each sitting person."""
        if self._first:
            return self._first.room
        stools = [w.to for person in self.scenario.people for w in person.path if w.sit]
        room = room_mesh(self.scenario.room, self.seed, stools=stools)
        return furnished(room, self.scenario.furniture)

    @property
    def frame_count(self) -> int:
        """Number of frames."""
        return round(self.scenario.duration_s * self.scenario.camera.fps)

    def frame_s(self, index: int) -> float:
        """Return the time [s] of a frame."""
        return index / self.scenario.camera.fps + self.scenario.camera.phase_s

    def stamp_ns(self, index: int) -> int:
        """Return the stamp of a frame, on the camera's clock."""
        return stamp_ns(self.scenario.camera.clock_s(self.frame_s(index)))

    def time_ns(self, stamp: int) -> int:
        """Return the true time of a stamp on the camera's clock."""
        return stamp_ns(self.scenario.camera.true_s((stamp - EPOCH_NS) / 1e9))

    def poses(self, t_s: float) -> tuple[BodyPose, ...]:
        """Return the poses of all people at a time."""
        return tuple(motion.at(t_s) for motion in self.motions)

    def keypoints_m(self, t_s: float) -> list[F64]:
        """Return the keypoints of all people at a time: 17x3 each, COCO order, frame: map."""
        held = zip(self.bodies, self.poses(t_s), strict=True)
        return [body.keypoints_m(pose) for body, pose in held]

    def meshes(self, t_s: float) -> tuple[Mesh, ...]:
        """Return the bodies at a time; the owner of person k is k + 1."""
        held = zip(self.bodies, self.poses(t_s), strict=True)
        meshes = tuple(body.mesh(pose, k + 1) for k, (body, pose) in enumerate(held))
        for mesh in meshes:
            # Soles sink below the floor by up to a millimetre; they are not drawn below it.
            np.maximum(mesh.vertices_m[:, 2], 0.0, out=mesh.vertices_m[:, 2])
        return meshes

    def surfaces(self, t_s: float) -> tuple[Mesh, ...]:
        """Return everything in the room at a time: bodies, wheelchairs and objects."""
        objects = [one.mesh(t_s) for one in self.objects]
        return (*self.meshes(t_s), *self._wheelchairs(t_s), *objects)

    def _wheelchairs(self, t_s: float) -> list[Mesh]:
        pairs = zip(self.scenario.people, self.motions, strict=True)
        paths = [motion.path(t_s)[0] for person, motion in pairs if person.wheelchair]
        return [moved(wheelchair(), (x, y), np.degrees(yaw)) for x, y, yaw in paths]

    def map_from_optical(self, t_s: float) -> F64:
        """Return the pose of the camera's optical frame, 4x4."""
        return self.path.map_from_optical(t_s)

    def optical_from_map(self, t_s: float) -> F64:
        """Return the transform into the camera's optical frame, 4x4."""
        return invert(self.path.map_from_optical(t_s))


def stamp_ns(t_s: float) -> int:
    """Return the stamp of a time since the start of a scenario."""
    return EPOCH_NS + round(t_s * 1e9)


def camera_info(plan: CameraPlan) -> CameraInfo:
    """Return the calibration of a planned camera, without distortion, centred optical axis.

    The centre of the first pixel is (0, 0), so the centre of the image is (size - 1) / 2.
    """
    return CameraInfo(
        stamp_ns=EPOCH_NS,
        sequence=0,
        camera=plan.name,
        frame_id=f"{plan.name}_optical_frame",
        width=plan.width,
        height=plan.height,
        fx=plan.focal_px,
        fy=plan.focal_px,
        cx=(plan.width - 1) / 2,
        cy=(plan.height - 1) / 2,
        max_depth_m=MAX_DEPTH_M,
    )
