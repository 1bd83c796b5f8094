"""Scores of tracks of several cameras against the ground truth of the lab."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.lib.fusion.run import TimedTracks
from benchmarks.lib.fusion.scene import FusionScene
from common.metrics.counts import Counts
from common.metrics.matching import Matching, match
from common.metrics.record import EvaluationFrame, EvaluationSequence, GroundTruth, Hypotheses
from common.metrics.scores import score_matching
from common.metrics.similarity import GroundDistance
from people4d.messages import F64, Track

SLOT_NS = 100_000_000  # [ns] period of scoring
MATCH_M = 0.5  # [m] maximum error of a match
LATER = range(8, 20)  # [0.1 s] time after a hand-over in which identities are compared
MEASURED_S = 0.1  # [s] maximum time since the last match of a measured position


def sequence_of(scene: FusionScene, found: Sequence[TimedTracks]) -> EvaluationSequence:
    """Return truth and tracks ten times a second."""
    frames, next_ns = [], 0
    for timed in sorted(found, key=lambda t: t.time_ns):
        if timed.time_ns < next_ns:
            continue
        next_ns = (timed.time_ns // SLOT_NS + 1) * SLOT_NS
        positions = scene.positions_m(timed.time_ns)
        views = scene.views(positions)
        tracks = {t.id: t for t in timed.tracks if t.state != "tentative"}
        frames.append(
            EvaluationFrame(
                stamp_ns=timed.time_ns,
                truth=GroundTruth(
                    ids=tuple(range(len(positions))),
                    positions_m=positions,
                    out_of_view=~np.any(list(views.values()), axis=0),
                ),
                hypotheses=Hypotheses(
                    ids=tuple(tracks),
                    positions_m=np.array([t.position_m for t in tracks.values()]).reshape(-1, 3),
                    predicted=np.array([_is_predicted(t) for t in tracks.values()], np.bool_),
                ),
            )
        )
    return EvaluationSequence("scene", tuple(frames))


def _is_predicted(track: Track) -> bool:
    """Check that no camera has matched a track recently."""
    return track.state == "lost" and track.time_since_update_s > MEASURED_S


def matched(scene: FusionScene, found: Sequence[TimedTracks]) -> Matching:
    """Return the matches of tracks and people within 0.5 m on the ground."""
    return match(sequence_of(scene, found), GroundDistance(MATCH_M))


def double_share(matching: Matching) -> float:
    """Return the share of people in view with a second, measured track, over all frames."""
    double = total = 0
    for frame, matches in zip(matching.sequence.frames, matching.frame_matches, strict=True):
        truth, tracks = frame.truth.positions_m, frame.hypotheses.positions_m
        assert truth is not None
        assert tracks is not None
        total += int(matches.required.sum())
        unmatched = np.setdiff1d(np.arange(len(tracks)), matches.columns)
        unmatched = unmatched[~frame.hypotheses.was_predicted[unmatched]]
        if not len(unmatched) or not len(truth):
            continue
        distance = np.linalg.norm(
            truth[matches.rows][:, None, :2] - tracks[unmatched][:, :2], axis=-1
        )
        double += int((distance < MATCH_M).any(axis=1).sum()) if distance.size else 0
    return double / max(total, 1)


@dataclass(frozen=True)
class HandOvers(Counts):
    """Numbers of hand-overs from camera to camera, in total and with the same identity."""

    overlapping: int = 0
    overlapping_same: int = 0
    apart: int = 0
    apart_same: int = 0


@dataclass(frozen=True)
class FusionScore:
    """Scores of one method on one scene."""

    mota: float
    idf1: float
    hota: float
    rmse_m: float
    double: float
    switches_per_min: float
    hand_overs: HandOvers


def hand_overs(scene: FusionScene, matching: Matching) -> HandOvers:
    """Count changes from the view of one camera to another, with and without a gap."""
    return sum((_of_person(*one) for one in _by_person(scene, matching)), HandOvers())


def _by_person(scene: FusionScene, matching: Matching) -> Iterator[tuple[F64, F64]]:
    """Yield flags of views (TxC) and numbers of tracks (T, -1: none) of each person."""
    frames = matching.sequence.frames
    tracked = np.full((len(frames), scene.people_m.shape[1]), -1)
    for k, matches in enumerate(matching.frame_matches):
        tracked[k, matches.persons[matches.rows]] = matches.tracks[matches.columns]
    persons = {number: int(name) for number, name in enumerate(matching.persons)}
    column = {person: number for number, person in persons.items()}
    views = [scene.views(np.asarray(frame.truth.positions_m)) for frame in frames]
    for person in range(scene.people_m.shape[1]):
        if person in column:
            in_views = [[view[c][person] for c in sorted(scene.infos)] for view in views]
            yield np.array(in_views), tracked[:, column[person]]


def _of_person(in_views: F64, tracked: F64) -> HandOvers:
    """Count the hand-overs of one person.

    Args:
        in_views: TxC flags, ten a second.
        tracked: T, number of the track, -1 without a track.
    """
    counts = [0, 0, 0, 0]
    for k in range(1, len(in_views) - LATER.stop):
        left = np.flatnonzero(in_views[k - 1] & ~in_views[k])
        for camera in left:
            stays = in_views[k : k + 10].all(axis=0) & in_views[max(k - 3, 0) : k].all(axis=0)
            away = not in_views[k : k + 10, camera].any()
            before = in_views[max(k - 10, 0) : k, camera].all()
            if away and before and np.any(np.delete(stays, camera)):
                counts[0] += 1
                counts[1] += _is_same(tracked, k, k)
    for gone, returned in gaps(in_views):
        counts[2] += 1
        counts[3] += _is_same(tracked, gone, returned)
    return HandOvers(*counts)


def gaps(in_views: F64) -> Iterator[tuple[int, int]]:
    """Yield the times at which a person leaves all views, and returns in view of another camera.

    Args:
        in_views: TxC flags, ten a second.
    """
    last_camera: int | None = None
    gone = 0
    for k in range(1, len(in_views) - LATER.stop):
        if not in_views[k].any():
            gone += 1
            continue
        if last_camera is not None and not in_views[k, last_camera] and 5 <= gone <= 100:
            yield k - gone, k
        last_camera, gone = int(np.flatnonzero(in_views[k])[0]), 0


def _is_same(tracked: F64, left: int, returned: int) -> bool:
    before = tracked[max(left - 10, 0) : left]
    after = tracked[returned + LATER.start : returned + LATER.stop]
    before, after = before[before >= 0], after[after >= 0]
    return bool(len(before) and len(after) and before[-1] == np.bincount(after).argmax())


def score_of(scene: FusionScene, matching: Matching) -> FusionScore:
    """Return the scores of tracks."""
    scores = score_matching(matching)
    row = scores.row()
    return FusionScore(
        mota=row["mota"] or 0.0,
        idf1=row["idf1"] or 0.0,
        hota=row["hota"] or 0.0,
        rmse_m=position_rmse_m(matching),
        double=double_share(matching),
        switches_per_min=scores.id_switches_per_min,
        hand_overs=hand_overs(scene, matching),
    )


def position_rmse_m(matching: Matching) -> float:
    """Return the RMSE on the ground of measured tracks; NaN without tracks."""
    squares = [np.zeros(0)]
    for frame, matches in zip(matching.sequence.frames, matching.frame_matches, strict=True):
        truth, tracks = frame.truth.positions_m, frame.hypotheses.positions_m
        assert truth is not None
        assert tracks is not None
        apart_m = (truth[matches.rows] - tracks[matches.columns])[:, :2]
        measured = ~frame.hypotheses.was_predicted[matches.columns]
        squares.append((apart_m[measured] ** 2).sum(axis=1))
    found = np.concatenate(squares)
    return float(np.sqrt(found.mean())) if len(found) else float("nan")


def score_row(start: Sequence[str], scored: Sequence[FusionScore]) -> list[str]:
    """Return a row of means over scenes."""
    total = sum((one.hand_overs for one in scored), HandOvers())

    def mean(field: str) -> float:
        return float(np.mean([getattr(one, field) for one in scored]))

    return [
        *start,
        *(f"{100 * mean(field):.1f}" for field in ("mota", "idf1", "hota")),
        f"{mean('rmse_m'):.3f}",
        f"{100 * mean('double'):.2f}",
        f"{total.overlapping_same} of {total.overlapping}",
        f"{total.apart_same} of {total.apart}",
        f"{mean('switches_per_min'):.1f}",
    ]
