"""People tracked by four cameras at once, against the ground truth of the lab.

Detections are synthetic (lab, geometry). Embeddings are synthetic, too: a histogram for each person
with noise and with gains of the camera. One tracker with all cameras is compared with a single
camera and with a merger of single-camera tracks. Faults of clocks and cameras follow.
"""

import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from benchmarks.lib import options
from benchmarks.lib.each import each
from benchmarks.lib.fusion.areas import AreaHandOvers, area_hand_overs, track_areas
from benchmarks.lib.fusion.changes import Change, covered, dead, knocked, late_clock, nothing
from benchmarks.lib.fusion.played_detections import RATE_HZ, cost
from benchmarks.lib.fusion.run import Statement, merge, track
from benchmarks.lib.fusion.scene import FusionScene, read_fusion_scene
from benchmarks.lib.fusion.scores import FusionScore, matched, score_of, score_row
from benchmarks.lib.table import markdown, write
from evaluation.cache import default_folder, key_of
from lab.output.render import Outputs, render
from lab.output.sequence import RenderJob
from lab.random_scenario import random_scenario
from lab.scenario import CapturePlan, Scenario

FIRST_SEED = 2000
SECONDS = 72
PEOPLE = {"overlapping": 6, "apart": 5}
HEADER = [
    *("cameras", "MOTA", "IDF1", "HOTA", "position RMSE m", "double people %"),
    *("id the same after a hand-over in view", "after a gap", "ID switches a min"),
]
COSTS = ((1, 10), (2, 10), (4, 10), (8, 10), (12, 10), (8, 20), (12, 30), (12, 60))
FEW = 2  # number of scenes with faults and corrections
COST_ABOUT = (
    "Processor time of the tracker's node, without transport: detections played at 15 Hz a camera "
    "with embeddings, each camera sees the ten nearest people; the median of three runs."
)
TWENTY_MIN_NS = 1_200_000_000_000
FAULTS_ABOUT = (
    f"The first {FEW} scenes. Health: reason of the tracker, or of the doctor by the gauges of "
    "clocks, with the numbers of the last scene; number of scenes with that reason, and its first "
    "second in the scene."
)
FAULTS_HEADER = ["fault", "health says", "scenes", "from s"]
AREAS_ABOUT = (
    "Two areas: two of the cameras and a tracker in each, people of both in one stream by the "
    "site's node, 15 Hz. A walk: a person is in view of one area alone, then of the other alone "
    "for 2 s. Joined: identities that an area took from the other for a person in both views. "
    "Sent: by each area to its neighbour."
)
AREAS_HEADER = [
    *("two areas", "MOTA", "IDF1", "HOTA", "position RMSE m", "double people %"),
    *("id the same after a walk", "ID switches a min", "joined", "sent kbit/s"),
]


def _scene(kind: str, seed: int) -> Scenario:
    layout = "ring" if kind == "overlapping" else "apart"
    options = f"cameras=4&people={PEOPLE[kind]}&layout={layout}&fps=15&duration_s={SECONDS}"
    scene = random_scenario(f"random?depth_sensor=d435i&{options}", seed)
    return replace(scene, capture=CapturePlan(rate_hz=20))


ABOUT = (
    "Synthetic detections of the lab, d435i, 15 Hz each, seeds used for nothing else. Scored ten "
    "times a second over the people in view of any camera, matches within 0.5 m on the ground. "
    "Positions: of tracks that any camera matched within 0.1 s. One camera: the best of four by "
    "position RMSE. Double people have a second, measured track within 0.5 m. A hand-over in "
    "view: a person leaves the view of one camera and stays in another view. After a gap: the "
    "person appears before another camera 0.5 to 10 s later. The identity is that of the last "
    "second before, 0.8 to 2 s later. Occluded people are in view here: MOTA counts them as missed."
)


def render_scene(kind: str, seed: int) -> Path:
    """Return the recording of a scene, rendered if it is not in the cache."""
    job = RenderJob(scenario=_scene(kind, seed), seed=seed, fidelity="geometry")
    path = default_folder() / "cameras" / f"{seed}-{key_of(job)[:16]}.mcap"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        render(job, Outputs(recording=path), 1, lambda *_: None)
    return path


def main() -> None:
    """Track all scenes and write the tables."""
    parser = options.parser(__doc__)
    parser.add_argument("--seeds", type=int, default=9)
    arguments = parser.parse_args()
    parts: list[str] = []
    for kind, people in PEOPLE.items():
        seeds = range(FIRST_SEED, FIRST_SEED + arguments.seeds)
        scenes = [read_fusion_scene(render_scene(kind, seed), seed) for seed in seeds]
        parts += [
            f"## Four cameras, {kind}",
            f"{people} people, {len(scenes)} seeds, {SECONDS * len(scenes) / 60:.1f} min in all.",
            markdown(HEADER, _methods(scenes)),
        ]
        if kind == "overlapping":
            faults = _faults(scenes[:FEW])
            parts += ["### Faults", FAULTS_ABOUT, markdown([*FAULTS_HEADER, *HEADER[1:]], faults)]
        parts += [f"### {kind.capitalize()}, two areas", markdown(AREAS_HEADER, _areas(scenes))]
    parts += ["## Cost", COST_ABOUT, _costs()]
    write(__file__, "People tracked by several cameras", ABOUT, AREAS_ABOUT, *parts)


def _methods(scenes: Sequence[FusionScene]) -> list[list[str]]:
    """Return rows of the best single camera, of a merger of tracks and of one tracker."""

    def scores(scene: FusionScene) -> list[FusionScore]:
        single = {name: track(scene, nothing, [name])[0] for name in scene.infos}
        fused, _ = track(scene, nothing)
        alone = [score_of(scene, matched(scene, found)) for found in single.values()]
        best = min(alone, key=lambda one: one.rmse_m if np.isfinite(one.rmse_m) else np.inf)
        others = (score_of(scene, matched(scene, found)) for found in (merge(single), fused))
        return [best, *others]

    names = ("one camera, the best", "four, nearest-neighbour merger", "four, one tracker")
    by_method = zip(*each(scores, scenes), strict=True)
    return [score_row([name], found) for name, found in zip(names, by_method, strict=True)]


def _faults(scenes: Sequence[FusionScene]) -> list[list[str]]:
    start_ns = int(scenes[0].times_ns[0])
    quarter_ns = start_ns + SECONDS * 10**9 // 4
    faults: dict[str, Change] = {
        "none": nothing,
        "clock of c2 0.5 s behind": late_clock("c2", -0.5, 0.0, start_ns),
        "clock of c2 drifts by 100 ppm": late_clock("c2", 0.0, 100.0, start_ns),
        "the same, since 20 min": late_clock("c2", 0.0, 100.0, start_ns - TWENTY_MIN_NS),
        "c2 dead or hung from 18 s on": dead("c2", quarter_ns),
        "c2 covered from 18 s on": covered("c2", quarter_ns),
        "c2 knocked by 5 deg at 18 s": knocked("c2", 5.0, quarter_ns),
    }

    def score(scene: FusionScene) -> list[tuple[FusionScore, list[Statement]]]:
        found = [track(scene, change) for change in faults.values()]
        return [
            (score_of(scene, matched(scene, tracks)), statements) for tracks, statements in found
        ]

    rows = []
    for name, results in zip(faults, zip(*each(score, scenes), strict=True), strict=True):
        scored, texts, after_s = [], dict[str, str](), list[float]()
        for scene, (scores, statements) in zip(scenes, results, strict=True):
            scored.append(scores)
            frequent = [s for s in statements if s.count > 1]
            texts |= {re.sub(r"\d+", "#", s.text): s.text for s in frequent}
            after_s += [(s.first_ns - scene.times_ns[0]) / 1e9 for s in frequent[:1]]
        when = f"{min(after_s):.0f} to {max(after_s):.0f}" if after_s else "-"
        reports = "; ".join(texts.values()) or "nothing"
        rows.append(score_row([name, reports, f"{len(after_s)} of {len(scenes)}", when], scored))
    return rows


def _areas(scenes: Sequence[FusionScene]) -> list[list[str]]:
    """Return rows of two areas, each with half of the cameras, without and with hand-over."""

    def score(scene: FusionScene, exchange: bool) -> tuple[FusionScore, AreaHandOvers, int, int]:
        cameras = sorted(scene.infos)
        half = len(cameras) // 2
        areas = {"a": cameras[:half], "b": cameras[half:]}
        run = track_areas(scene, areas, exchange)
        walks, matching = area_hand_overs(scene, areas, run.merged)
        joined = sum(counters.get("identities_joined", 0) for counters in run.counters.values())
        return score_of(scene, matching), walks, joined, run.bytes_sent

    rows = []
    for name, exchange in (("do not hear each other", False), ("hand identities over", True)):
        results = each(partial(score, exchange=exchange), scenes)
        scored, walks, joined, sent = zip(*results, strict=True)
        *scores, _, _, switches = score_row([name], scored)
        kbps = sum(sent) * 8 / 1e3 / (SECONDS * len(scenes) * 2)
        walked = f"{sum(w.same for w in walks)} of {sum(w.walks for w in walks)}"
        rows.append([*scores, walked, switches, str(sum(joined)), f"{kbps:.0f}"])
    return rows


def _costs() -> str:
    """Return processor time of the tracker by cameras and people."""
    rows = []
    for cameras, people in COSTS:
        # Median of three, since the speed of a shared machine varies.
        share, tracks = sorted(cost(cameras, people, 5.0) for _ in range(3))[1]
        per_frame_ms = 1e3 * share / (cameras * RATE_HZ)
        rows.append(
            [
                str(cameras),
                str(people),
                f"{tracks:.1f}",
                f"{100 * share:.0f}",
                f"{per_frame_ms:.2f}",
            ]
        )
    return markdown(["cameras", "people", "tracks", "% of a core", "ms a frame"], rows)
