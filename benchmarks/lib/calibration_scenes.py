"""Scenes of the lab for the calibration of several cameras, rendered once, and their truth."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from common.calibration.observations import CameraObservations, ObservationCollector
from common.calibration.tags.boards import Board, Tag
from common.calibration.tags.fusion import TagPose, tag_poses
from common.calibration.tags.observer import TagObserver
from common.geometry.transforms import apply, invert, project
from common.io.recording import open_recording
from evaluation.cache import default_folder, key_of
from lab.camera.frames import FrameRenderer, RenderSettings
from lab.camera.synthetic_detections import SyntheticDetectionsConfig
from lab.depth.config import DepthSensorModel
from lab.output.render import Outputs, render
from lab.output.sequence import ErrorModels, RenderJob
from lab.random_scenario import random_scenario
from lab.scenario import CapturePlan, PersonPlan, Scenario, Waypoint
from lab.world import World
from people4d.messages import F32, F64, CameraInfo, Detections

TRANSPORT_S, JITTER_S = 0.2, 0.02  # largest delay of a camera, mean of each message's own
SELDOM = CapturePlan(rate_hz=1)  # truth about people is not needed
# Overlap of neighbours' views 3 m before them [m], distance of the cameras [m], time [s].
MEETING_M, MEETING_POSITIONS = 0.8, 6  # about the middle between two cameras; before going on
ROWS = ((2.0, 1.12, 120), (1.5, 1.62, 120), (1.0, 2.12, 240))
TAG_NOISE_PX, TAG_SIGMA_M = 0.3, 0.005  # errors of corners, and of what is said of the place
DEPTHS = 6  # images of depth of each camera, for the floor
BASE = "random?depth_sensor=d435i&clocks=free"
USUAL = SyntheticDetectionsConfig()
# Noise of positions twice the measured one, and the front of the body in place of its middle.
ROUGH = SyntheticDetectionsConfig(
    keypoint_share=0.018,
    recall=0.93,
    no_position=0.05,
    false_alarms=0.1,
    front_m=0.05,
    side_m=0.08,
    sensor=DepthSensorModel(noise_px=0.14),
)
CLUTTERED = SyntheticDetectionsConfig(false_alarms=0.5)


@dataclass(frozen=True)
class SceneKind:
    """Scenes that differ by their seed."""

    name: str
    scenario: Callable[[int], Scenario]
    detector: SyntheticDetectionsConfig = USUAL
    scale_of_c2: float = 1.0  # of its positions across: a wrong focal length
    depths: int = 0  # images of depth of each camera that reach the calibration
    tagged: tuple[str, ...] = ()  # cameras that see two tags each


@dataclass(frozen=True)
class CalibrationScene:
    """Observations of cameras, and their true poses and clocks."""

    observed: Sequence[CameraObservations]
    map_from_camera: dict[str, F64]  # 4x4
    clock_s: dict[str, float]  # ahead of the true time, in the middle of the scene
    tags: dict[str, TagPose]  # poses by tags


def with_depth(kind: SceneKind) -> SceneKind:
    """Return the same scenes, with depth images."""
    return dataclasses.replace(kind, name=f"{kind.name}_depth", depths=DEPTHS)


def drawn(options: str, duration_s: float = 60) -> Callable[[int], Scenario]:
    """Return scenes drawn at random."""
    name = f"{BASE}&{options}&duration_s={duration_s}"
    return lambda seed: replace(random_scenario(name, seed), capture=SELDOM)


def still(seed: int) -> Scenario:
    """Return two people who stand."""
    scene = random_scenario(f"{BASE}&cameras=4&people=2&duration_s=60", seed)
    starts = ((0.5, 0.3), (-0.7, -0.4))
    people = tuple(
        replace(person, start=start, path=(), repeat=False)
        for person, start in zip(scene.people, starts, strict=True)
    )
    return replace(scene, people=people, duration_s=20.0, capture=SELDOM)


def mirrored(seed: int) -> Scenario:
    """Return two people alike, each where the other would be if the floor were turned by 180."""
    scene = random_scenario(f"{BASE}&cameras=4&people=2&outfit=own&duration_s=60", seed)
    rng = np.random.default_rng(seed)
    corners = [(float(x), float(y)) for x, y in rng.uniform((0.6, -1.8), (2.2, 1.8), (8, 2))]
    people = tuple(
        PersonPlan(
            body="twin_a",
            start=(side * corners[0][0], side * corners[0][1]),
            path=tuple(Waypoint(to=(side * x, side * y)) for x, y in corners[1:]),
            repeat=True,
        )
        for side in (1, -1)
    )
    return replace(scene, people=people, name="mirrored", capture=SELDOM)


def between(row_m: float, seed: int) -> Scenario:
    """Return two people in a row of cameras who walk for 4 min where the views of two meet."""
    options = f"cameras=4&people=2&layout=row&row_m={row_m}&duration_s=240"
    scene = random_scenario(f"{BASE}&{options}", seed)
    rng = np.random.default_rng([seed, 0xBE])
    people = []
    for person, order in zip(scene.people, ((0, 1, 2), (2, 0, 1)), strict=True):
        middles = np.repeat([(k - 1) * row_m for k in order], MEETING_POSITIONS)
        x = middles + rng.uniform(-MEETING_M, MEETING_M, len(middles))
        y = rng.uniform(2.0, 4.4, len(middles))
        corners = list(zip(x.tolist(), y.tolist(), strict=True))
        path = tuple(Waypoint(to=corner) for corner in corners[1:])
        people.append(replace(person, start=corners[0], path=path, repeat=True))
    return replace(scene, people=tuple(people), name="between", capture=SELDOM)


def render_scene(kind: SceneKind, seed: int) -> Path:
    """Render a scene, unless it was rendered before, and return its recording."""
    plan = kind.scenario(seed)
    job = RenderJob(
        scenario=plan, seed=seed, fidelity="geometry", errors=ErrorModels(detector=kind.detector)
    )
    path = default_folder() / "calibration" / f"{plan.seed}-{key_of(job)[:16]}.mcap"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        render(job, Outputs(recording=path), 1, lambda *_: None)
    return path


def read_scene(kind: SceneKind, seed: int) -> CalibrationScene:
    """Return a scene with times of transport that differ by camera."""
    views = World(kind.scenario(seed), seed).views
    rng = np.random.default_rng([seed, 0x7A])
    delays_s = {view.info.camera: float(rng.uniform(0, TRANSPORT_S)) for view in views}
    infos = {view.info.camera: view.info for view in views}
    collector = ObservationCollector()
    for time_ns, message in _messages(render_scene(kind, seed)):
        late_s = delays_s[message.camera] + rng.exponential(JITTER_S)
        if message.camera == "c2" and isinstance(message, Detections):
            message = _scaled(message, kind.scale_of_c2, infos.get("c2"))
        collector.add(message, time_ns + round(late_s * 1e9))
    for view in views:
        _add_depths(collector, view, kind.depths)
    middle_s = views[0].scenario.duration_s / 2
    return CalibrationScene(
        observed=collector.cameras,
        map_from_camera={view.info.camera: view.map_from_optical(0.0) for view in views},
        clock_s={
            view.info.camera: view.scenario.camera.clock_s(middle_s) - middle_s for view in views
        },
        tags=_by_tags([view for view in views if view.info.camera in kind.tagged], seed),
    )


def _by_tags(views: Sequence[World], seed: int) -> dict[str, TagPose]:
    """Return poses by a tag on a wall and one on the floor before each camera, both of 0.3 m."""
    rng = np.random.default_rng([seed, 0x7A6])
    found = dict[str, F64]()
    corners_m = dict[str, F64]()
    for view in views:
        pose, camera = view.map_from_optical(0.0), view.info.camera
        x, y = pose[:2, 3].tolist()
        tags: dict[str, Tag | Board] = {
            "wall": Tag(size_m=0.3, position_m=(x - 0.5, y + 3.2, 1.2), facing_deg=-75),
            "floor": Tag(size_m=0.3, position_m=(x + 0.5, y + 3.0, 0.0), facing_deg=90, flat=True),
        }
        observer = TagObserver(tags)
        pixels = dict[str, F32]()
        for name, tag in tags.items():
            true_m = apply(invert(pose), tag.corners_m + rng.normal(0, TAG_SIGMA_M, 3))
            noise_px = rng.normal(0, TAG_NOISE_PX, (4, 2))
            pixels[name] = (project(true_m, view.info) + noise_px).astype(np.float32)
        observer.add_corners(camera, pixels)
        found |= observer.poses({camera: view.info})
        corners_m[camera] = observer.corners_m(camera)
    return tag_poses(found, corners_m, {view.info.camera: view.info for view in views})


def _add_depths(collector: ObservationCollector, view: World, count: int) -> None:
    renderer, camera = FrameRenderer(view, RenderSettings(colour="flat")), view.info.camera
    for index in np.linspace(0, view.frame_count - 1, count).astype(int).tolist():
        depth_mm = renderer.depth_mm(index, renderer.view(index))
        collector.add_depth(camera, view.stamp_ns(index), depth_mm)


def _messages(path: Path) -> Iterator[tuple[int, CameraInfo | Detections]]:
    for time_ns, message in open_recording(path).messages(CameraInfo, Detections):
        if isinstance(message, CameraInfo | Detections):
            yield time_ns, message


def _scaled(message: Detections, scale: float, info: CameraInfo | None) -> Detections:
    """Return detections as a wrong focal length has them: rays and positions farther out."""
    if scale == 1.0 or info is None:
        return message
    middle = np.array([info.cx, info.cy, 0.0], np.float32)
    factors = np.array([scale, scale, 1.0], np.float32)
    people = tuple(
        replace(
            d,
            position_m=None if d.position_m is None else d.position_m * factors,
            keypoints=None if d.keypoints is None else (d.keypoints - middle) * factors + middle,
        )
        for d in message.detections
    )
    return replace(message, detections=people)


TWO = SceneKind("two", drawn("cameras=4&people=2"))
ROUGH_KIND = SceneKind("rough", drawn("cameras=4&people=2"), ROUGH)
IN_A_ROW = [
    SceneKind(f"row_{overlap_m}", drawn(f"cameras=4&people=2&layout=row&row_m={row_m}", time_s))
    for overlap_m, row_m, time_s in ROWS
]
BETWEEN = SceneKind("row_1.0_between", partial(between, ROWS[-1][1]))
KINDS = (
    TWO,
    with_depth(TWO),
    SceneKind("one", drawn("cameras=4&people=1")),
    *IN_A_ROW,
    with_depth(IN_A_ROW[-1]),
    dataclasses.replace(IN_A_ROW[-1], name="row_1.0_tags", tagged=("c1", "c4")),
    BETWEEN,
    with_depth(BETWEEN),
    SceneKind("row", drawn("cameras=4&people=2&layout=row")),
    SceneKind("row_long", drawn("cameras=4&people=2&layout=row", 240)),
    SceneKind("crowd", drawn("cameras=4&people=4")),
    ROUGH_KIND,
    with_depth(ROUGH_KIND),
    SceneKind("cluttered", drawn("cameras=4&people=2"), CLUTTERED),
    SceneKind("apart", drawn("cameras=4&people=4&layout=apart")),
    SceneKind("focal", drawn("cameras=4&people=2"), scale_of_c2=1.1),
    SceneKind("mirrored", mirrored),
    SceneKind("still", still),
)
