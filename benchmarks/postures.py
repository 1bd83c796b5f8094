"""Postures, falls and gestures: simulated people as geometry with detector errors, and real ones.

Tracker, skeletons and events run in memory on detections without images. Constants are tuned on the
seeds CHOOSING; TESTING is the test split. Frames within 0.5 s of a change of posture do not count.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from benchmarks.lib import options
from benchmarks.lib.intervals import poisson_rate
from benchmarks.lib.postures.falls import (
    FOUND_S,
    FallScene,
    fall_rows,
    match_falls,
    peer_falls,
    rows_of,
)
from benchmarks.lib.postures.falls import HEADER as FALL_HEADER
from benchmarks.lib.postures.fit import fit, labelled_frames
from benchmarks.lib.postures.real import HEADER as REAL_HEADER
from benchmarks.lib.postures.real import real_rows
from benchmarks.lib.postures.run import Frame, frames, true_posture
from benchmarks.lib.postures.scenes import daily_life, fall
from benchmarks.lib.table import markdown, write
from lab.bodies.skeleton import INDEX, map_from_segments
from lab.motion.acts import down_s, is_fall
from lab.world import World
from people4d.messages import Event
from people4d.messages.skeleton import POSTURES
from services.events.build import build as build_events
from services.events.config import EventsConfig

CHOOSING = range(1, 1000)
TESTING = range(2000, 3000)  # earlier ones were seen while rules were chosen
HEADER = ("true posture", "frames", *POSTURES, "no skeleton", "recall", "precision")
GESTURES = {"raised_hand": ("raise", "wave"), "waved": ("wave",), "pointed": ("point",)}
REAL = (
    "Real people, with the default detector. Postures of uc3m are annotated by eye, in images that "
    "are not between two postures. Falls: events in the whole recording."
)
FALLS = (
    "Falls by another package on the same boxes and keypoints, in images of 10 Hz; it confirms a "
    "fall for 0.6 to 1.5 s. False: no fall ended within the 3 s before, or 1 s after."
)


class Counts:
    """Counts over all scenes."""

    def __init__(self) -> None:
        self.confusion = Counter[tuple[str, str]]()
        self.figures = Counter[str]()
        self.pointing_deg: list[float] = []
        self.falls: list[FallScene] = []

    def add_counts(self, other: "Counts") -> None:
        """Add the counts of other scenes."""
        self.confusion.update(other.confusion)
        self.figures.update(other.figures)
        self.pointing_deg += other.pointing_deg
        self.falls += other.falls

    def add_scene(self, world: World) -> None:
        """Run a scene and count its frames and events."""
        events, node = list[tuple[Event, Frame]](), build_events(EventsConfig())
        played = list(frames(world))
        for frame in played:
            for message in frame.messages:
                found = node.handle(message, 0)
                events += [(event, frame) for event in found if isinstance(event, Event)]
            for person, skeleton in enumerate(frame.skeletons):
                label = true_posture(world, person, frame.time_s)
                if label is not None:
                    name = "no skeleton" if skeleton is None else skeleton.posture
                    self.confusion[label, name] += 1
        self.figures["person_s"] += round(world.scenario.duration_s * len(world.scenario.people))
        self._count_falls(world, played, events)
        self._count_gestures(world, events)

    def _count_falls(
        self, world: World, played: Sequence[Frame], events: Sequence[tuple[Event, Frame]]
    ) -> None:
        acts = [act for plan in world.scenario.people for act in plan.acts]
        ends_s = [down_s(act) for act in acts if is_fall(act)]
        times_s = [frame.time_s for event, frame in events if event.kind == "fell"]
        found, false = match_falls(ends_s, times_s, FOUND_S)
        self.figures["acts"] += len(acts) - len(ends_s)
        self.figures["falls"] += len(ends_s)
        self.figures["falls_found"] += found
        self.figures["false_falls"] += false
        all_s = np.array([frame.time_s for frame in played])
        self.falls.append(FallScene(ends_s, times_s, rows_of(played), all_s))

    def _count_gestures(self, world: World, events: Sequence[tuple[Event, Frame]]) -> None:
        for kind, moves in GESTURES.items():
            reported = [(event, frame) for event, frame in events if event.kind == kind]
            for number, plan in enumerate(world.scenario.people):
                for gesture in plan.gestures:
                    if gesture.move not in moves:
                        continue
                    begin_s, end_s = gesture.at_s, gesture.at_s + gesture.for_s
                    near = [
                        (event, frame)
                        for event, frame in reported
                        if begin_s <= frame.time_s <= end_s + 0.5 and _is_of(event, frame, number)
                    ]
                    self.figures[kind] += 1
                    self.figures[f"{kind}_found"] += bool(near)
                    reported = [one for one in reported if one not in near]
                    if kind == "pointed" and near:
                        event, frame = near[0]
                        self.pointing_deg.append(_error_deg(world, number, event, frame.time_s))
            self.figures[f"false_{kind}"] += len(reported)


def _is_of(event: Event, frame: Frame, person: int) -> bool:
    track = frame.tracks[person]
    return track is not None and track.id == event.id


def _error_deg(world: World, person: int, event: Event, time_s: float) -> float:
    """Return the angle between the direction of an event and the higher true arm."""
    pose = world.poses(time_s)[person]
    arms = [-map_from_segments(pose)[INDEX[f"upper_arm_{end}"]][:, 2] for end in "lr"]
    arm = max(arms, key=lambda direction: float(direction[2]))
    assert event.direction is not None
    return float(np.degrees(np.arccos(np.clip(arm @ event.direction, -1, 1))))


def count_scene(scene: tuple[Callable[[int], World], int]) -> Counts:
    """Return the counts of a scene, from its function and seed."""
    make, seed = scene
    counts = Counts()
    counts.add_scene(make(seed))
    return counts


def scenes(
    seeds: Sequence[int], daily: int, falls: int
) -> Iterator[tuple[Callable[[int], World], int]]:
    """Yield scenes of daily life and of falls."""
    for number, seed in enumerate(seeds[: max(daily, falls)]):
        if number < daily:
            yield daily_life, seed
        if number < falls:
            yield fall, seed


def rows(confusion: Counter[tuple[str, str]]) -> Iterator[list[str]]:
    """Yield a row of the confusion matrix for each posture."""
    for label in POSTURES[:-1]:
        given = {name: confusion[label, name] for name in (*POSTURES, "no skeleton")}
        total = sum(given.values())
        with_skeleton = total - given["no skeleton"]
        named = sum(confusion[other, label] for other in POSTURES)
        recall = f"{given[label] / with_skeleton:.3f}" if with_skeleton else "-"
        precision = f"{given[label] / named:.3f}" if named else "-"
        yield [label, str(total), *map(str, given.values()), recall, precision]


def _rate(count: int, hours: float) -> str:
    """Return a rate with its exact 95 % interval."""
    return "{:.2f} ({:.2f} to {:.2f})".format(*poisson_rate(count, hours))


def summary(counts: Counts) -> list[str]:
    """Return the figures of events in sentences."""
    n, hours = counts.figures, counts.figures["person_s"] / 3600
    lines = [f"{hours:.2f} person-hours."]
    lines.append(
        f"Falls found within {FOUND_S:g} s: {n['falls_found']} of {n['falls']}; "
        f"false: {n['false_falls']} in {n['acts']} other movements of the whole body, "
        f"{_rate(n['false_falls'], hours)} a person-hour."
    )
    lines += [
        f"`{kind}`: {n[f'{kind}_found']} of {n[kind]}; false: {n[f'false_{kind}']}, "
        f"{n[f'false_{kind}'] / hours:.1f} a person-hour."
        for kind in GESTURES
    ]
    if counts.pointing_deg:
        lines.append(f"Error of the pointing arm: median {np.median(counts.pointing_deg):.1f} deg.")
    return lines


def main() -> None:
    """Run the scenes and write the table."""
    parser = options.parser(__doc__, "shared", "cache", "jobs", "dry")
    parser.add_argument("--scenes", type=int, default=300, help="of daily life, 60 s each")
    parser.add_argument("--falls", type=int, default=60, help="scenes with a fall, 14 s each")
    parser.add_argument(
        "--fit", action="store_true", help="print states fitted to seeds for choosing"
    )
    parser.add_argument("--peers", help="interpreter with neura-fall-detection")
    parser.add_argument("--choose", action="store_true", help="seeds for choosing; nothing written")
    asked = parser.parse_args()
    seeds = CHOOSING if asked.choose or asked.fit else TESTING
    chosen = list(scenes(seeds, asked.scenes, asked.falls))
    if asked.fit:
        frames = [one for make, seed in chosen for one in labelled_frames(make(seed))]
        print(*fit(frames), sep="\n")
        return
    if asked.peers:
        peer_falls(asked.peers, ())  # fails before the run if the package is absent
    counts = Counts()
    with ProcessPoolExecutor(asked.jobs) as pool:
        for found in pool.map(count_scene, chosen):
            counts.add_counts(found)
            print(*summary(counts), flush=True)
    note = " ".join(summary(counts)) + " Recall is of frames with a skeleton."
    hours = counts.figures["person_s"] / 3600
    peers = list(fall_rows(counts.falls, hours, asked.peers))
    table = markdown(HEADER, list(rows(counts.confusion)))
    table += f"\n\n{FALLS}\n\n{markdown(FALL_HEADER, peers)}"
    if asked.shared.exists():
        table += (
            f"\n\n{REAL}\n\n{markdown(REAL_HEADER, list(real_rows(asked.shared, asked.cache)))}"
        )
    command, dry = f"benchmarks postures --scenes {asked.scenes}", asked.choose or asked.dry
    write(__file__, "Postures, falls and gestures", note, table, dry=dry, command=command)


if __name__ == "__main__":
    main()
