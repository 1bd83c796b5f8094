"""One chosen person in a scene, by the service and by identities alone."""

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from common.io.recording import open_recording
from common.metrics.record import EvaluationFrame, Id
from evaluation.run.run import EvaluationRun, RunOutput
from people4d.messages import Detections, Embeddings, Target, TargetCommand, Tracks
from services.target.build import build
from services.target.config import TargetConfig

NEAR_M = 0.5  # maximum distance on the ground of the track of a chosen person [m]
ALONE_M = 1.0  # minimum distance of other people from a person who is chosen [m]
WRONG_M = 0.6  # distance on the ground above which a track is not on a person [m]
AGE_MIN = 5  # minimum age of a chosen track [frames]
RESTART_S = 60.0  # interval of restarts of the service [s]


@dataclass(frozen=True)
class PlayedFrame:
    """Messages and truth of one frame."""

    truth: EvaluationFrame
    tracks: Tracks
    detections: Detections
    embeddings: Embeddings | None

    @property
    def boxed(self) -> set[int]:
        """Tracks with a detection."""
        return {t.id for t in self.tracks.tracks if t.detection is not None}

    @property
    def embedded(self) -> set[int]:
        """Tracks with the embedding of a crop."""
        crops = self.embeddings.detections if self.embeddings else ()
        return {t.id for t in self.tracks.tracks if t.detection in crops}


@dataclass(frozen=True)
class Choice:
    """A true person and the track by which the person is chosen."""

    person: Id
    track: int
    frame: int  # index of the first frame after the choice


@dataclass(frozen=True)
class FollowedFrame:
    """One frame of a chosen person."""

    stamp_ns: int
    is_visible: bool  # True: the person is in view and at least 35 % visible
    is_locked: bool
    is_wrong: bool  # True: the locked track is on another person, and not on the chosen one
    is_stray: bool  # True: the locked track is on no person


# Yields the locked track of each frame from the choice on; None: not locked
Rule = Callable[[Sequence[PlayedFrame], Choice], Iterator[int | None]]


def played_frames(run: EvaluationRun, output: RunOutput) -> list[PlayedFrame]:
    """Return the frames of a run with tracks and truth."""
    assert run.embeddings
    vectors = {m.stamp_ns: m for _, m in open_recording(run.embeddings).messages(Embeddings)}
    detections = {m.stamp_ns: m for m in output.detections}
    frames = []
    for truth in output.matching.sequence.frames:
        crops, stamp_ns = vectors.get(truth.stamp_ns), truth.stamp_ns
        if stamp_ns in output.tracks:
            assert crops is None or isinstance(crops, Embeddings)
            frames.append(PlayedFrame(truth, output.tracks[stamp_ns], detections[stamp_ns], crops))
    return frames


def choices(frames: Sequence[PlayedFrame]) -> list[Choice]:
    """Return each person with crops with the first track that is the person's beyond doubt."""
    found: dict[Id, Choice] = {}
    for index, frame in enumerate(frames[:-1]):
        ages = {t.id: t.age for t in frame.tracks.tracks}
        truth, tracked = frame.truth.truth, frame.truth.hypotheses
        assert truth.positions_m is not None
        assert tracked.positions_m is not None
        for row, person in enumerate(truth.ids):
            at_m = truth.positions_m[row, :2]
            apart_m = np.linalg.norm(truth.positions_m[:, :2] - at_m, axis=1)
            if person in found or not truth.required[row] or (apart_m < ALONE_M).sum() > 1:
                continue
            for track, position_m in zip(tracked.ids, tracked.positions_m, strict=True):
                is_old = isinstance(track, int) and ages.get(track, 0) >= AGE_MIN
                if is_old and track in frame.embedded and math.dist(position_m[:2], at_m) < NEAR_M:
                    found[person] = Choice(person, int(track), index + 1)
    return list(found.values())


def follow(frames: Sequence[PlayedFrame], choice: Choice, rule: Rule) -> list[FollowedFrame]:
    """Return the frames of a chosen person from the choice on."""
    followed = []
    for frame, track in zip(frames[choice.frame :], rule(frames, choice), strict=True):
        truth, tracked = frame.truth.truth, frame.truth.hypotheses
        rows, columns = _indices(truth.ids), _indices(tracked.ids)
        assert truth.positions_m is not None
        assert tracked.positions_m is not None
        row, on = rows.get(choice.person), list[Id]()
        if track is not None and track in columns:
            apart_m = truth.positions_m[:, :2] - tracked.positions_m[columns[track], :2]
            near = np.linalg.norm(apart_m, axis=1) <= WRONG_M
            on = [person for person, is_near in zip(truth.ids, near, strict=True) if is_near]
        is_wrong = bool(on) and choice.person not in on
        is_stray = track is not None and not on
        is_visible = row is not None and bool(truth.required[row])
        stamp_ns = frame.truth.stamp_ns
        is_locked = track is not None
        followed.append(FollowedFrame(stamp_ns, is_visible, is_locked, is_wrong, is_stray))
    return followed


def by_service(probability_min: float) -> Rule:
    """Return the rule of the service, which restarts every RESTART_S."""
    config = TargetConfig(probability_min=probability_min)

    def rule(frames: Sequence[PlayedFrame], choice: Choice) -> Iterator[int | None]:
        for target, _ in _served(config, frames, choice):
            yield target.id if target.state == "locked" else None

    return rule


def work_ms(frames: Sequence[PlayedFrame], choice: Choice, people_min: int) -> list[float]:
    """Return the own work of the service in frames with a number of tracks or more [ms]."""
    served = zip(frames[choice.frame :], _served(TargetConfig(), frames, choice), strict=True)
    return [ms for frame, (_, ms) in served if len(frame.tracks.tracks) >= people_min]


def _served(
    config: TargetConfig, frames: Sequence[PlayedFrame], choice: Choice
) -> Iterator[tuple[Target, float]]:
    """Yield the service's answer and its own work [ms] for each frame from the choice on."""
    node, start_ns = build(config), frames[0].truth.stamp_ns
    for index, frame in enumerate(frames):
        if index == choice.frame:
            node.handle(TargetCommand(stamp_ns=0, sequence=0, action="id", id=choice.track), 0)
        if frame.truth.stamp_ns - start_ns > RESTART_S * 1e9:
            saved, start_ns = node.save(), frame.truth.stamp_ns
            node = build(config)
            node.restore(saved, 0)
        begin_s = time.thread_time()
        node.handle(frame.detections, 0)
        if frame.embeddings:
            node.handle(frame.embeddings, 0)
        (target,) = node.handle(frame.tracks, 0)
        assert isinstance(target, Target)
        if index >= choice.frame:
            yield target, 1e3 * (time.thread_time() - begin_s)


def by_track(frames: Sequence[PlayedFrame], choice: Choice) -> Iterator[int | None]:
    """Yield the track of the choice whenever it has a detection."""
    for frame in frames[choice.frame :]:
        yield choice.track if choice.track in frame.boxed else None


def _indices(ids: Sequence[Id]) -> Mapping[Id, int]:
    return {id_: index for index, id_ in enumerate(ids)}
