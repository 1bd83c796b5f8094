"""Gait on people of another simulator: points visible and hidden, left and right, steps.

The recordings are folders with the joints of all people (`gt.npz`, see docs/cameras/truth.md), each
run from images to steps as `people4d gait` does.
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.gait_scenes import SCENES, TO_AND_FRO
from benchmarks.lib import options
from benchmarks.lib.gait.bodies import JointTruth, tally
from benchmarks.lib.gait.other_walkers import Style
from benchmarks.lib.gait.tally import Tally, cells, results_of, total
from benchmarks.lib.table import machine, markdown
from evaluation.gait.report import read_run
from services.gait.estimator import GaitFrame

REPORT = Path(__file__).with_name("gait_bodies.md")
FAST_MPS = 1.2
BY_STYLE = (
    *("steps found", "invented", "worst step cm", "worst cadence %", "limps found"),
    *("hands visible cm", "feet visible cm", "visible published %", "hidden as measured %"),
    *("exchanged visible %", "exchanged hidden %"),
)  # figures
DEPTH_MAX_M = 5.0  # farthest reading of the sensor
MARGIN_PX = 4.0  # of ankles in view to the edges
NO_KEYPOINTS = "gait.cascade.depth.keypoints=false"
WITHOUT_KEYPOINTS = (
    *("steps found", "invented", "hands visible cm", "hands visible, measured cm"),
    *("hands hidden cm", "feet visible cm", "feet visible, measured cm", "feet hidden cm"),
    *("limbs visible cm", "visible published %", "visible measured %", "hidden as measured %"),
    *("exchanged visible %", "exchanged hidden %"),
)  # figures
INTRO = """
People of a second simulator, with other bodies and another walk than the lab's. Errors are median
and 90th percentile of the distance to the surface at the middle of hand and foot, made from the
joints (wrist and ankle). A point is hidden where its joint is. `hidden as measured`: of the points
published while hidden, predicted or measured; below, of these the ones more than 0.1 m off (of a
foot the ankle may be covered and the toes not), then of all hidden points, lost ones too.
`exchanged`: nearer to the other side's reference by 10 cm. `in 90 % ellipse`: predicted points.
A true step is a swing of an ankle by 0.2 m or more; found within 0.3 s. The film may begin in a
step: it is neither asked for nor invented. Walkers take three steps or more in view. `in range`:
nearer than 5 m, beyond which the sensor gives no depth: there a joint may be visible in colour
alone. Estimates and true people are paired one to one in each frame, by their heads; a pair stays
while it is near [Bernardin 2008]. `worst cadence`: of steady walking, true and published, without
steps of more than 1.6 times the median (turns, starts, stops; turns are measured apart [El-Gohary
2014]); `turns`: the published one against the mean of all true strides, those of turns included.
`live`: measures published in the second after their fourth step. A limp is a true asymmetry of step
times of 8 % or more. The scenes `choose` and `judge` are made by `python -m
benchmarks.gait_scenes`: constants and rules of today were chosen on `choose`, `two`, `robot` and
the lab (gait.md), those before on other scenes of this simulator; the weights of visible hands were
fitted to `choose_1`, `choose_2`, `choose_turns`, `choose_circles`, `two` and `robot`; people of
`judge` have other bodies and styles. They walk in a room, 2.8 to 4.7 m from the sensor, which
stands at 0.5 to 2.0 m and has 12 to 30 frames a second. choose_1: a limp of 20 %, hands in pockets;
choose_2: slow with bent trunk, carrying a box; turns: stops, turns on the spot and U-turns;
choose_circles: three people, of whom one walks circles of 0.4 m with stops, one carries and one is
behind the others; judge_1: slow with bent trunk, fast; judge_2: hands in pockets, a limp of 20 %;
judge_3: a limp of 10 %, a skirt; judge_4: three people, of whom one stops and one carries; limp and
even: a robot follows a person who walks straight, or drives ahead of them, for 40 to 45 s. The
first two columns put the scenes of each half together.
"""


def read_truth(folder: Path, frames: Sequence[GaitFrame]) -> JointTruth:
    """Return the truth of a folder in the frame of the estimates."""
    with np.load(folder / "gt.npz") as file:
        data = {name: file[name] for name in ("t", "kp3d", "kp2d", "kpvis", "T_world_cam", "K")}
    count = min(len(frames), len(data["t"]))
    width, height = 2 * data["K"][2], 2 * data["K"][3]
    joints_m = data["kp3d"][:count].astype(np.float64)
    camera_m = np.empty((count, 3))
    depth_m = np.empty(joints_m.shape[:3])
    for index, frame in enumerate(frames[:count]):
        optical = np.linalg.inv(data["T_world_cam"][index])
        depth_m[index] = joints_m[index] @ optical[2, :3] + optical[2, 3]
        moved = frame.fixed_from_optical @ optical
        joints_m[index] = joints_m[index] @ moved[:3, :3].T + moved[:3, 3]
        camera_m[index] = frame.fixed_from_optical[:3, 3]
    ankles_px = data["kp2d"][:count, :, 15:17]
    inside = (ankles_px > MARGIN_PX) & (ankles_px < (width - MARGIN_PX, height - MARGIN_PX))
    visible = data["kpvis"][:count].astype(bool)
    in_view = inside.all(axis=(2, 3))
    return JointTruth(
        data["t"][:count], joints_m, visible, camera_m, in_view, depth_m < DEPTH_MAX_M
    )


def compare(folder: Path, settings: Sequence[str] = ()) -> list[Tally]:
    """Run a folder from images to steps, and return the comparisons of each person."""
    run = read_run(str(folder), None, "", run_settings(folder, settings))
    frames, results = results_of(run)
    truth = read_truth(folder, frames)
    return tally(truth, results, [frame.stamp_ns for frame in frames])


def run_settings(folder: Path, settings: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the settings of a run: the rate of the frames, and odometry where the camera moves."""
    with np.load(folder / "gt.npz") as file:
        fps = 1 / float(np.median(np.diff(file["t"])))
        moves = not np.allclose(file["T_world_cam"], file["T_world_cam"][:1])
    frame = ("tracker.frame_id=odom",) if moves else ()
    return (f"camera.options.fps={fps:.6g}", *frame, *settings)


def style_name(style: Style) -> str:
    """Return what is special in a walk."""
    names = {
        "skirt": style.skirt,
        "slow, bent trunk": style.lean_rad > 0,
        "carrying a box": style.arms == "carry",
        "hands in pockets": style.arms == "pockets",
        "limp": style.limp != 0,
        "fast": style.speed_mps > FAST_MPS,
        "turns on the spot, U-turns, stops": style.path == TO_AND_FRO
        or any(len(point) > 2 for point in style.path),
    }
    return next((name for name, is_so in names.items() if is_so), "round or straight")


def style_rows(people: Mapping[str, Sequence[Tally]]) -> list[list[str]]:
    """Return the figures by style and half, of the people of scenes by name."""
    found: dict[tuple[str, str], list[Tally]] = {}
    for name, tallies in people.items():
        if name in SCENES:
            for style, one in zip(SCENES[name].people, tallies, strict=True):
                found.setdefault((style_name(style), name.split("_")[0]), []).append(one)
    rows = []
    for (style_text, half), tallies in sorted(found.items()):
        values = cells(total(tallies))
        rows.append([style_text, half, str(len(tallies)), *(values[key] for key in BY_STYLE)])
    return rows


def compare_all(
    pool: ProcessPoolExecutor, folders: Sequence[Path], settings: Sequence[str]
) -> Mapping[str, list[Tally]]:
    """Return the comparisons of each person by folder."""
    tasks = {folder.name: pool.submit(compare, folder.resolve(), settings) for folder in folders}
    people: dict[str, list[Tally]] = {}
    for name, task in tasks.items():
        people[name] = task.result()
        print(name, *settings, flush=True)
    return people


def by_scene(people: Mapping[str, Sequence[Tally]]) -> dict[str, Mapping[str, str]]:
    """Return the figures of each half, and of each scene."""
    held_out = {name for name in people if name.startswith("judge_")}
    groups = {"all of judge": held_out, "all others": people.keys() - held_out}
    groups |= {name: {name} for name in people}
    return {
        title: cells(total(one for name in scenes for one in people[name]))
        for title, scenes in groups.items()
    }


def main() -> None:
    """Compare the folders, and write the report."""
    parser = options.parser(__doc__, "jobs")
    parser.add_argument("folders", nargs="+", type=Path, help="recordings with gt.npz")
    parser.add_argument("--set", dest="settings", action="append", default=[], help="as people4d")
    parser.add_argument("--report", type=Path, default=REPORT, help="file to write")
    arguments = parser.parse_args()
    with ProcessPoolExecutor(arguments.jobs, get_context("spawn")) as pool:
        people = compare_all(pool, arguments.folders, arguments.settings)
        alone = compare_all(pool, arguments.folders, [*arguments.settings, NO_KEYPOINTS])
    table, without = by_scene(people), by_scene(alone)
    rows = [[name, *(cell[name] for cell in table.values())] for name in next(iter(table.values()))]
    rows_without = [
        [name, *(cell[name] for cell in without.values())] for name in WITHOUT_KEYPOINTS
    ]
    command = " ".join(f"FOLDER/{folder.name}" for folder in arguments.folders)
    text = "\n\n".join(
        [
            "# Gait of people of another simulator",
            f"Made by `python -m benchmarks gait_bodies {command}` on {machine()}.",
            " ".join(INTRO.split()),
            markdown(["figure", *table], rows),
            f"The same without keypoints (`{NO_KEYPOINTS}`): hands and feet by "
            "the ends of limbs alone; the limits are 5 cm (median) and 15 cm of visible ones:",
            markdown(["figure", *without], rows_without),
            "The same people by style, in scenes that chose and in scenes that judge:",
            markdown(["style", "half", "people", *BY_STYLE], style_rows(people)),
        ]
    )
    arguments.report.write_text(text + "\n", encoding="utf-8")
    print(text)
