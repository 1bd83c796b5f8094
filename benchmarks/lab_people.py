"""Accuracy of preset `best` in random lab scenes of real difficulty.

Scenes are drawn from seeds, see `lab.random_scenario`. Tune constants on the seeds CHOOSING only;
TEST_SEEDS is the test split. Renderings and detections are in the cache of `people4d evaluate`: the
same command resumes an interrupted run.
"""

from collections.abc import Sequence
from pathlib import Path

from benchmarks.ablation import LAB_GROUPS, SIZE, TEST_SEEDS, report_progress, score_scene
from benchmarks.lib import options
from benchmarks.lib.table import markdown, write
from benchmarks.lib.true_identities import with_true_identities
from common.metrics.scores import Row, combine
from evaluation.methods import read_method
from evaluation.pool import Pool
from evaluation.recordings.recordings import plan_recordings
from evaluation.run.preparation import EvaluationPlan, check_models, render_all, runs_of
from evaluation.run.run import RunScores

CHOOSING = range(1, TEST_SEEDS.start)
NAMES = ("two people", "four people", "six in dark clothes", "two people, plain")
GROUPS = dict(zip(NAMES, LAB_GROUPS, strict=True))
RECORDED = f"random?density=0.15&view=robot&{SIZE}"
FPS = 10.0  # frame rate of random scenes [Hz]
COLUMNS = (
    ("position_rmse_across_m", "across m", "{:.3f}"),
    ("position_rmse_along_m", "along m", "{:.3f}"),
    ("velocity_rmse_across_mps", "velocity across m/s", "{:.3f}"),
    ("velocity_rmse_along_mps", "along m/s", "{:.3f}"),
    ("yaw_rmse_deg", "yaw deg", "{:.1f}"),
    ("yaw_correlation", "yaw correlation", "{:.3f}"),
    ("id_switches_per_min", "ID switches a min", "{:.2f}"),
    ("share_reidentified", "re-identified", "{:.1%}"),
    ("coverage", "coverage", "{:.1%}"),
)
HEADER = ("scenes", *(title for _, title, _ in COLUMNS), "invented tracks s/min", "IDF1")
NOTE = (
    "Seeds {first} to {last} of each group, used for nothing else; seeds below {choosing} "
    "are for choosing. {scenes}. 10 Hz; except `plain` with the image and the depth of a cheap "
    "camera, half of the people in dark clothes, furniture, high and tilted cameras. All frames in "
    "which a person is in view and at least 35 % of them is visible, measured or predicted; "
    "re-identified are those who come back after two seconds or more. `Invented`: seconds that "
    "tracks spend on no person in view, in a minute of the recording. `Identities known`: with "
    "embeddings that are the identity of the nearest true person, the upper bound of what "
    "appearance can give this tracker. The scenes are few: single events decide. A pair of person "
    "and track stays while they are within a metre [Bernardin 2008], so an exchange of two people "
    "who stand together counts as errors of position and yaw, too."
)


def row(group: str, results: Sequence[RunScores]) -> list[str]:
    """Return a row of the pooled scenes of a group."""
    figures = combine(result.scores for result in results).row()
    cells = [text(figures, figure, form) for figure, _, form in COLUMNS]
    false_alarms, duration_s = figures["false_alarms"], figures["duration_s"]
    invented = "-" if not duration_s else f"{(false_alarms or 0) / FPS * 60 / duration_s:.1f}"
    return [group, *cells, invented, text(figures, "idf1", "{:.1%}")]


def text(row: Row, figure: str, form: str) -> str:
    """Return a figure as text, "-" if undefined."""
    value = row[figure]
    return "-" if value is None else form.format(value)


def main() -> None:
    """Render, track and write the table."""
    parser = options.parser(__doc__, "jobs", "cache")
    parser.add_argument("--scenes", type=int, default=10, help="of each group")
    parser.add_argument("--choose", action="store_true", help="seeds for choosing; nothing written")
    parser.add_argument("--paths", type=Path, help="folder of recorded paths, for one more group")
    asked = parser.parse_args()
    seeds = list((CHOOSING if asked.choose else TEST_SEEDS)[: asked.scenes])
    groups = dict(GROUPS)
    if asked.paths:
        groups["recorded paths"] = f"{RECORDED}&paths={asked.paths.absolute()}"
    lines, everyone, known = [], list[RunScores](), list[RunScores]()
    with Pool(asked.jobs, report_progress) as pool:
        for group, name in groups.items():
            recordings = plan_recordings([f"lab:{name}"], seeds, "colour", asked.cache.absolute())
            plan = EvaluationPlan(
                (read_method("best"),),
                tuple(recordings),
                asked.cache.absolute(),
                asked.jobs,
                figures=False,
            )
            check_models(plan)
            render_all(plan, report_progress)
            runs = runs_of(plan, pool)
            results = pool.do("tracking", score_scene, runs)
            everyone += results
            known += pool.do("tracking", score_scene, [with_true_identities(one) for one in runs])
            lines.append(row(group, results))
            print(*lines[-1], sep=" | ", flush=True)
    lines += [row("all", everyone), row("all, identities known", known)]
    table = markdown(HEADER, lines)
    scenes = "; ".join(f"{group}: `lab:{name}`" for group, name in GROUPS.items())
    note = NOTE.format(first=seeds[0], last=seeds[-1], choosing=CHOOSING.stop, scenes=scenes)
    write(__file__, "People in scenes as hard as real ones", note, table, dry=asked.choose)
