"""Gait of people of the lab with other bodies, clothes and ways to walk, in two halves.

Scenes are drawn from seeds: constants may be chosen on those of CHOOSING; those of JUDGING serve
this table alone. Recordings are kept in the cache of `people4d evaluate`.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.gait_scenes import visible_joints
from benchmarks.lib.gait.bodies import JointTruth, tally
from benchmarks.lib.gait.tally import Tally, cells, results_of, total
from benchmarks.lib.table import machine, markdown
from evaluation.cache import default_folder, key_of
from evaluation.gait.report import read_run
from lab.bodies.cast import cast_names
from lab.bodies.outfits import Outfit
from lab.camera.plan import CameraPlan
from lab.catalogue import FOLDER
from lab.drawing.renderer import draw_depth
from lab.output.chunks import digest_of
from lab.output.render import Outputs, render
from lab.output.sequence import RenderJob
from lab.scenario import PersonPlan, Scenario, WalkStyle, Waypoint
from lab.truth.frames import person_views
from lab.truth.motion_capture import footfalls
from lab.world import World
from services.gait.estimator import GaitFrame

REPORT = Path(__file__).with_suffix(".md")
HALVES: Mapping[str, Sequence[int]] = {"choose": range(1, 5), "judge": range(101, 105)}
SECONDS = 10.0
FAR_M = 5.0  # farthest reading of the sensor
MARGIN_PX = 4.0  # of ankles in view to the edges
BASELINE_M = 0.05  # of the right imager, which is not used
STYLES: Mapping[str, tuple[WalkStyle, float, Outfit]] = {
    "usual, skirt": (WalkStyle(), 0.9, "skirt"),
    "fast, coat": (WalkStyle(cadence=1.05), 1.35, "coat"),
    "slow": (WalkStyle(), 0.55, "random"),
    "elderly": (WalkStyle(cadence=1.2, lean_deg=22.0), 0.6, "random"),
    "limp, left steps longer": (WalkStyle(limp=0.2), 0.85, "random"),
    "limp, right steps longer": (WalkStyle(limp=-0.2), 0.85, "own"),
    "as with a box": (WalkStyle(arms="carry"), 0.9, "random"),
    "hands in pockets": (WalkStyle(arms="pockets"), 1.0, "dark"),
}  # by name: style, speed in m/s and clothes
COLUMNS = (
    *("steps found", "invented", "walkers with measures", "worst step cm", "worst cadence %"),
    *("limps found", "limps invented", "hands visible cm", "feet visible cm"),
    *("visible published %", "hidden as measured %", "exchanged visible %"),
    *("exchanged hidden %", "hidden in 90 % ellipse %"),
)
INTRO = """Two people of the lab walk {seconds:.0f} s, to and fro, across the view or round, 2.4 to
4.8 m from a camera 0.4 to 2.4 m high with 10 to 30 frames a second; bodies are 0.88 to 1.12 times
as tall as in the cast. Figures, true steps and what is hidden are defined as in gait_bodies.md; a
step is invented if it is at no footfall of the simulation, small ones included.
All walks have U-turns or turns at corners every few steps. No constant was chosen on these scenes;
both halves have all styles, with other bodies, paths and cameras."""


def scene(seed: int) -> tuple[Scenario, list[str]]:
    """Return a scene and the styles of its people; seeds 1 to 4, and so on, have all styles."""
    rng = np.random.default_rng([seed, 20])
    order = np.random.default_rng([(seed - 1) // 100, 21]).permutation(len(STYLES))
    names = [list(STYLES)[k] for k in order[2 * ((seed - 1) % 4) :][:2]]
    bodies = rng.choice([name for name in cast_names() if "twin" not in name], 2, replace=False)
    people = []
    for name, body, side in zip(names, bodies, (-1, 1), strict=True):
        style, speed_mps, outfit = STYLES[name]
        path = _path(rng, side * float(rng.uniform(0.55, 0.75)))
        people.append(
            PersonPlan(
                body=str(body),
                start=path[0],
                face_deg=float(np.degrees(np.arctan2(*np.subtract(path[1], path[0])[::-1]))),
                speed_mps=speed_mps,
                repeat=True,
                path=tuple(Waypoint(to=to) for to in (*path[1:], path[0])),
                outfit=outfit,
                size=float(rng.uniform(0.88, 1.12)),
                style=style,
            )
        )
    height_m = float(rng.uniform(0.4, 2.4))
    camera = CameraPlan(
        at=(0.0, 0.0, height_m),
        pitch_deg=float(np.degrees(np.arctan2(height_m - 0.85, 3.6))),
        fps=float(rng.choice([10.0, 15.0, 20.0, 30.0])),
        avoided=False,
    )
    about = f"Gait: {names[0]} and {names[1]}."
    return Scenario(
        about=about, duration_s=SECONDS, seed=seed, room="hall", camera=camera, people=tuple(people)
    ), names


def _path(rng: np.random.Generator, y_m: float) -> list[tuple[float, float]]:
    """Return the waypoints of a person in their own half of the view."""
    near_m, far_m = rng.uniform(2.6, 2.9), rng.uniform(4.2, 4.6)
    kind = rng.choice(["to and fro", "round"])
    if kind == "to and fro":
        return [(far_m, y_m), (near_m, 0.75 * y_m)]
    out_m, in_m = 1.25 * y_m, 0.5 * y_m
    return [(far_m, out_m), (near_m, 0.75 * y_m), (near_m + 0.3, in_m), (far_m, in_m)]


def truth_of(world: World, frames: Sequence[GaitFrame]) -> JointTruth:
    """Return the truth of the frames that were run, in the frame of the estimates."""
    joints, visible, in_view, in_range = [], [], [], []
    for index in range(len(frames)):
        t_s = world.frame_s(index)
        meshes, pose = world.meshes(t_s), world.optical_from_map(t_s)
        view = draw_depth([world.room.mesh, *meshes], pose, world.info, BASELINE_M)
        people = person_views(world, t_s, view, meshes)
        joints.append([one.keypoints_m for one in people])
        depth_m = np.array(joints[-1]) @ pose[2, :3] + pose[2, 3]
        own, deep_m = [one.keypoints_px for one in people], view.depth_m.astype(np.float64)
        visible.append([visible_joints(px, z, deep_m) for px, z in zip(own, depth_m, strict=True)])
        ankles = np.array([one.keypoints_px[15:17] for one in people])
        size = np.array([world.info.width, world.info.height])
        inside = (ankles > MARGIN_PX) & (ankles < size - MARGIN_PX)
        in_view.append(inside.all(axis=(1, 2)))
        in_range.append(depth_m < FAR_M)
    return JointTruth(
        times_s=np.array([world.frame_s(index) for index in range(len(frames))]),
        joints_m=np.array(joints, np.float64),
        visible=np.array(visible, bool),
        camera_m=np.array([frame.fixed_from_optical[:3, 3] for frame in frames]),
        in_view=np.array(in_view, bool),
        in_range=np.array(in_range, bool),
        footfalls=[footfalls(world, k) for k in range(len(world.scenario.people))],
    )


def compare(seed: int) -> dict[str, Tally]:
    """Render a scene unless it is cached, run it from images to steps, and compare it by style."""
    scenario, names = scene(seed)
    job = RenderJob(scenario=scenario, seed=seed, depth="measured", samples=1)
    key = key_of(msgspec.to_builtins(job), digest_of(FOLDER.parent))
    path = default_folder() / "scenes" / f"gait-styles@{seed}-{key[:16]}.mcap"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        render(job, Outputs(recording=path), 1, lambda _text, _ratio: None)
    frames, results = results_of(read_run(str(path), None, "", ()))
    truth = truth_of(World(scenario, seed), frames)
    return dict(zip(names, tally(truth, results, [f.stamp_ns for f in frames]), strict=True))


def main() -> None:
    """Compare all scenes, and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--report", type=Path, default=REPORT, help="file to write")
    arguments = parser.parse_args()
    rows = []
    for half, seeds in HALVES.items():
        people: list[tuple[str, Tally]] = []
        for seed in seeds:
            people += compare(seed).items()
            print(half, seed, flush=True)
        for name, one in [*people, ("all", total(one for _, one in people))]:
            values = cells(one)
            rows.append([name, half, *(values[key] for key in COLUMNS)])
    text = "\n\n".join(
        [
            "# Gait of other bodies and styles in the lab",
            f"Made by `python -m benchmarks.gait_styles` on {machine()}.",
            " ".join(INTRO.format(seconds=SECONDS).split()),
            markdown(["style", "half", *COLUMNS], sorted(rows)),
        ]
    )
    arguments.report.write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
