"""People tracked by four cameras at once, against the ground truth of the lab.

    python -m benchmarks cameras [--seeds 9]

Detections are synthetic (lab, geometry), embeddings too: a histogram for each person with noise and
with gains of the camera. All cameras go into one tracker, beside one camera alone, and beside a
merger that joins tracks of single cameras to the nearest. Then what fails: clocks, and cameras.
"""

import re
import time
from collections.abc import Sequence
from functools import partial

from msgspec.structs import replace

from benchmarks.lib import options
from benchmarks.lib.calibration_scenes import SceneKind, render_scene
from benchmarks.lib.each import each
from benchmarks.lib.fusion.areas import AreaHandOvers, area_hand_overs, track_areas
from benchmarks.lib.fusion.changes import Change, covered, dead, knocked, late_clock, nothing
from benchmarks.lib.fusion.delays import late_cases
from benchmarks.lib.fusion.gains import gains
from benchmarks.lib.fusion.methods import compare_methods
from benchmarks.lib.fusion.played_detections import RATE_HZ, cost
from benchmarks.lib.fusion.run import Statement, age_ms, track
from benchmarks.lib.fusion.scene import FusionScene, read_fusion_scene
from benchmarks.lib.fusion.scores import FusionScore, matched, score_of, score_row
from benchmarks.lib.table import markdown, write
from lab.random_scenario import random_scenario
from lab.scenario import CapturePlan, Scenario

FIRST_SEED = 2000
SECONDS = 72
PEOPLE = {"overlapping": 6, "apart": 5}
HEADER = [
    *("cameras", "MOTA", "IDF1", "HOTA", "position RMSE m", "double people %"),
    *("id the same after a hand-over in view", "after a gap", "ID switches a min"),
]
BEST_TOO = "m, in the frames of the best camera"

COSTS = ((1, 10), (2, 10), (4, 10), (8, 10), (12, 10), (8, 20), (12, 30), (12, 60))
FEW = 2  # scenes with faults and corrections
TWENTY_MIN_NS = 1_200_000_000_000
GAINS_ABOUT = (
    f"The first {FEW} scenes. Corrections with their true values: no estimate can gain more."
)
LATE_ABOUT = (
    f"The first {FEW} scenes. Stamps are right but where a clock is named; messages of a camera "
    "stay in order. Age: from the newest frame whose tracks are published to the time of each "
    "publication, 95th percentile, 60 ms of it for detection. Processor time: of the tracker's "
    "node, a second of the scene, to compare the rows."
)
LATE_HEADER = ["age ms", "processor ms"]
FAULTS_ABOUT = (
    f"The first {FEW} scenes. "
    "Health: the reason that the tracker gives, or the doctor by its gauges of clocks, with the "
    "numbers of the last scene; in how many scenes it is given for longer than a moment, and from "
    "which second of the scene on. The processes of a camera are seen by others, too: "
    "[faults](../docs/operation/faults.md)."
)
FAULTS_HEADER = ["fault", "health says", "scenes", "from s"]
AREAS_ABOUT = (
    "Two of the cameras and a tracker in each area, people of both in one stream by the site's "
    "node, 15 Hz. A walk: a person is seen in one area alone, and next in the other alone for 2 s. "
    "Joined: identities that one area took of the other for a person whom both see. Sent: by each "
    "area to its neighbour."
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


KINDS = tuple(SceneKind(kind, partial(_scene, kind)) for kind in PEOPLE)


def main() -> None:
    """Track all scenes and write the tables."""
    parser = options.parser(__doc__)
    parser.add_argument("--seeds", type=int, default=9)
    arguments = parser.parse_args()
    parts: list[str] = []
    for kind in KINDS:
        scenes = [
            read_fusion_scene(render_scene(kind, seed), seed)
            for seed in range(FIRST_SEED, FIRST_SEED + arguments.seeds)
        ]
        minutes = SECONDS * len(scenes) / 60
        methods, causes = compare_methods(scenes)
        parts += [
            f"## Four cameras, {kind.name}",
            f"{PEOPLE[kind.name]} people, {len(scenes)} seeds, {minutes:.1f} min in all.",
            markdown([*HEADER[:5], BEST_TOO, *HEADER[5:]], methods),
            causes,
        ]
        print(parts[-1], flush=True)
        if kind.name == "overlapping":
            parts += [
                "### Faults",
                FAULTS_ABOUT,
                markdown([*FAULTS_HEADER, *HEADER[1:]], _faults(scenes[:FEW])),
            ]
            print(parts[-1], flush=True)
            few = range(FIRST_SEED, FIRST_SEED + min(arguments.seeds, FEW))
            alike = [read_fusion_scene(render_scene(kind, seed), seed, 0.0) for seed in few]
            rows = _gains(scenes[:FEW], alike)
            parts += ["### What corrections could gain", GAINS_ABOUT, markdown(HEADER, rows)]
            print(parts[-1], flush=True)
            rows = _late(scenes[:FEW])
            parts += ["### Late messages", LATE_ABOUT, markdown([*HEADER, *LATE_HEADER], rows)]
            print(parts[-1], flush=True)
        parts += [
            f"### {kind.name.capitalize()}, two areas",
            AREAS_ABOUT,
            markdown(AREAS_HEADER, _areas(scenes)),
        ]
        print(parts[-1], flush=True)
    parts += [
        "## Cost",
        "Processor time of the tracker's node, without transport: detections played at 15 Hz a "
        "camera, each sees the ten people who are nearest to it, with embeddings; the median of "
        "three runs.",
        _costs(),
    ]
    write(__file__, "People tracked by several cameras", ABOUT, *parts)


ABOUT = (
    "Synthetic detections of the lab, d435i, 15 Hz each, seeds used for nothing else. Scored ten "
    "times a second over the people in view of any camera, matches within 0.5 m on the ground. "
    "Positions: of tracks that any camera matched within 0.1 s. One camera: the best of four by "
    "position RMSE. In its frames: errors of the people that it has, too, in its own frames; in "
    "those of others a position is up to 67 ms old. The best is chosen by its errors in each "
    "scene. A double person has a second, measured track within 0.5 m. A hand-over in view: a "
    "person leaves the view of one camera and stays in that of another; after a gap of 0.5 to 10 "
    "s: appears before another camera; the identity 0.8 to 2 s later is that of the last second "
    "before. A new track is published once its identity is decided, by two crops that show the "
    "person alone or after 0.5 s: who is in view for less may have none. Hidden people are in view "
    "here: MOTA counts them as missed."
)


def _gains(scenes: Sequence[FusionScene], alike: Sequence[FusionScene]) -> list[list[str]]:
    def score(pair: tuple[FusionScene, FusionScene]) -> list[tuple[str, FusionScore]]:
        return [(name, score_of(pair[0], matched(pair[0], found))) for name, found in gains(*pair)]

    found = each(score, list(zip(scenes, alike, strict=True)))
    rows = zip(*found, strict=True)
    return [score_row([row[0][0]], [scored for _, scored in row]) for row in rows]


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


def _late(scenes: Sequence[FusionScene]) -> list[list[str]]:
    """Return rows of messages that come late."""
    cases = late_cases(int(scenes[0].times_ns[0]))

    def score(scene: FusionScene) -> list[tuple[FusionScore, float, float]]:
        found = []
        for change, delays in cases.values():
            start_s = time.process_time()
            tracks, _ = track(scene, change, delays=delays)
            used_ms = 1e3 * (time.process_time() - start_s) / SECONDS
            found.append((score_of(scene, matched(scene, tracks)), age_ms(tracks), used_ms))
        return found

    rows = []
    for name, results in zip(cases, zip(*each(score, scenes), strict=True), strict=True):
        scored, ages_ms, used_ms = zip(*results, strict=True)
        more = [f"{sum(values) / len(scenes):.0f}" for values in (ages_ms, used_ms)]
        rows.append([*score_row([name], scored), *more])
    return rows


def _areas(scenes: Sequence[FusionScene]) -> list[list[str]]:
    """Return rows of two areas with half of the cameras each, without and with hand-over."""

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
        # The median of three: the speed of a shared machine changes.
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
