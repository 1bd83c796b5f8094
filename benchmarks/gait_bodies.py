"""Gait on people of another simulator: points visible and hidden, left and right, steps.

The recordings are folders with the joints of all people (`gt.npz`, see docs/cameras/truth.md), each
run from images to steps as `people4d gait` does.
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.gait_scenes import SCENES
from benchmarks.lib import options
from benchmarks.lib.gait.bodies import JointTruth, tally
from benchmarks.lib.gait.styles import style_name
from benchmarks.lib.gait.tally import Tally, cells, results_of, total
from benchmarks.lib.table import markdown, write
from evaluation.gait.report import read_run
from services.gait.estimator import GaitFrame

BY_STYLE = (
    *("steps found", "invented", "worst step cm", "worst cadence %", "limps found"),
    *("hands visible cm", "feet visible cm", "hidden as measured %", "exchanged visible %"),
)  # figures
DEPTH_MAX_M = 5.0  # Maximum reading of the sensor [m]
MARGIN_PX = 4.0  # Minimum distance of visible ankles from the image's edges [px]
NO_KEYPOINTS = "gait.cascade.depth.keypoints=false"
INTRO = """People of a second simulator, with other bodies and another walk than the lab's.

- `choose`: `choose_...`, `two` and `robot`, on which constants were chosen. `judge`: other bodies
  and styles, on which nothing was chosen. `python -m benchmarks.gait_scenes` renders the scenes.
- Errors [cm] are the median and the 90th percentile of the distance to the middle of hand or foot,
  computed from wrist and ankle. A point is hidden if its joint is.
- `live`: frames with measures in the second after a fourth step. `in range`: nearer than 5 m, the
  limit of the sensor.
- A true step is a swing of an ankle of 0.2 m or more. A published step within 0.3 s of it finds it.
- `worst cadence`: of steady walking, without steps longer than 1.6 times the median; `turns`: of
  all true strides.
- A limp is a true asymmetry of step times of 8 % or more.
- `hidden as measured`: share of the points published while hidden. `exchanged`: nearer to the other
  side's reference by 10 cm. `in 90 % ellipse`: predicted points.
- Estimates and true people are paired one to one by their heads; a pair lasts while it is near
  [Bernardin 2008]."""

PEERS = """Steps by event detectors of other packages that need neither angles nor heels and toes,
on the same positions of body and feet along the path, with keypoints:"""


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


def compare(
    folder: Path, settings: Sequence[str] = (), python: str = ""
) -> tuple[list[Tally], list[Tally]]:
    """Run a folder from images to steps, and return the comparisons of each person.

    The second ones are without keypoints; `python` runs the detectors of other packages.
    """
    run = read_run(str(folder), None, "", run_settings(folder, settings))
    alone = read_run(str(folder), None, "", [*settings, NO_KEYPOINTS]).gait
    frames, results, others = results_of(run, alone)
    truth, stamps_ns = read_truth(folder, frames), [frame.stamp_ns for frame in frames]
    return tally(truth, results, stamps_ns, python), tally(truth, others, stamps_ns)


def run_settings(folder: Path, settings: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the settings of a run: the frame rate, and odometry if the camera moves."""
    with np.load(folder / "gt.npz") as file:
        fps = 1 / float(np.median(np.diff(file["t"])))
        moves = not np.allclose(file["T_world_cam"], file["T_world_cam"][:1])
    frame = ("tracker.frame_id=odom",) if moves else ()
    return (f"camera.options.fps={fps:.6g}", *frame, *settings)


def by_style(people: Mapping[str, Sequence[Tally]]) -> dict[tuple[str, str], list[Tally]]:
    """Return the people of the named scenes by style and half."""
    found: dict[tuple[str, str], list[Tally]] = {}
    for name, tallies in people.items():
        if name in SCENES:
            for style, one in zip(SCENES[name].people, tallies, strict=True):
                found.setdefault((style_name(style), name.split("_")[0]), []).append(one)
    return dict(sorted(found.items()))


def style_rows(styles: Mapping[tuple[str, str], Sequence[Tally]]) -> list[list[str]]:
    """Return the figures by style and half."""
    rows = []
    for (style_text, half), tallies in styles.items():
        values = cells(total(tallies))
        rows.append([style_text, half, str(len(tallies)), *(values[key] for key in BY_STYLE)])
    return rows


def worst_style(styles: Mapping[tuple[str, str], Sequence[Tally]]) -> str:
    """Return the style of the test scenes with the largest share of missed and false steps.

    Empty without a test scene.
    """
    sums = {name: total(own) for (name, half), own in styles.items() if half == "judge"}
    if not sums:
        return ""
    name = max(
        sums, key=lambda key: (sums[key].invented - sums[key].found) / max(sums[key].true, 1)
    )
    one = sums[name]
    return f"Worst style of `judge`: {name}, {one.found} of {one.true} steps, {one.invented} false."


def compare_all(
    pool: ProcessPoolExecutor, folders: Sequence[Path], settings: Sequence[str], python: str
) -> tuple[dict[str, list[Tally]], dict[str, list[Tally]]]:
    """Return the comparisons of each person by folder, with keypoints and without."""
    tasks = {one.name: pool.submit(compare, one.resolve(), settings, python) for one in folders}
    people, alone = dict[str, list[Tally]](), dict[str, list[Tally]]()
    for name, task in tasks.items():
        people[name], alone[name] = task.result()
        print(name, flush=True)
    return people, alone


def peer_rows(people: Mapping[str, Sequence[Tally]]) -> list[list[str]]:
    """Return the steps that each method finds, ours first, in each half of the scenes."""
    halves = {half: total(own) for half, own in _halves(people).items()}
    rows = [["ours", *(f"{t.found} of {t.true}, {t.invented}" for t in halves.values())]]
    for method in halves["judge"].peers:
        sums = [np.sum(one.peers[method], axis=0).tolist() for one in halves.values()]
        rows.append([method, *(f"{found} of {true}, {extra}" for found, true, extra in sums)])
    return rows


def by_half(people: Mapping[str, Sequence[Tally]]) -> dict[str, Mapping[str, str]]:
    """Return the figures of each half of the scenes."""
    return {half: cells(total(tallies)) for half, tallies in _halves(people).items()}


def _halves(people: Mapping[str, Sequence[Tally]]) -> dict[str, list[Tally]]:
    found: dict[str, list[Tally]] = {"judge": [], "choose": []}
    for name, tallies in people.items():
        found["judge" if name.startswith("judge_") else "choose"] += tallies
    return found


def main() -> None:
    """Compare the folders, and write the report."""
    parser = options.parser(__doc__, "jobs")
    parser.add_argument("folders", nargs="+", type=Path, help="recordings with gt.npz")
    parser.add_argument("--set", dest="settings", action="append", default=[], help="as people4d")
    parser.add_argument("--peers", default="", help="interpreter with gaitkit and myogait")
    arguments = parser.parse_args()
    with ProcessPoolExecutor(arguments.jobs, get_context("spawn")) as pool:
        people, alone = compare_all(pool, arguments.folders, arguments.settings, arguments.peers)
    columns = {
        f"{half}, {how}": figures
        for how, found in (("with keypoints", people), ("without", alone))
        for half, figures in by_half(found).items()
    }
    styles = {"with keypoints": by_style(people), "without": by_style(alone)}
    rows = [
        [name, *(one[name] for one in columns.values())] for name in next(iter(columns.values()))
    ]
    write(
        __file__,
        "Gait of people of another simulator",
        INTRO,
        markdown(["figure", *columns], rows),
        *(
            f"By style, {how}. {worst_style(found)}".strip()
            + "\n\n"
            + markdown(["style", "half", "people", *BY_STYLE], style_rows(found))
            for how, found in styles.items()
        ),
        PEERS,
        markdown(["detector", "judge: found, invented", "choose"], peer_rows(people)),
    )
