"""Results of methods on marked real people, and their rows in tables."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from benchmarks.lib.marks.methods import HALVES
from benchmarks.lib.marks.recording import FrameOutput, MarkedRecording
from evaluation.recordings.hand_annotations import FPS
from evaluation.recordings.hand_marks import HIDDEN
from evaluation.recordings.mark_scores import (
    Figures,
    MarkOutcome,
    MarkScores,
    Share,
    TrackedPerson,
    figures,
)

SUMMARY_HEADER = (
    *("method", "found", "right identity", "first identity right", "identity changes"),
    *("taken over", "invented", "ghosts", "IDF1 %", "HOTA %"),
    *("position > 0.5 m off", "facing within 45 deg"),
)
HIDDEN_COLUMNS = ("found", "right identity", "position off", "facing")
HALF_COLUMNS = (
    *("found", "right identity", "less hidden", "IDF1 %", "HOTA %"),
    *("position off", "facing"),
)


@dataclass(frozen=True)
class Result:
    """One method on a recording."""

    name: str
    scores: MarkScores
    hypotheses: Mapping[int, Sequence[TrackedPerson]]
    has_identity: bool = True  # False: detections alone
    is_peer: bool = False  # True: a tracker of another package


def result(name: str, recording: MarkedRecording, outputs: Sequence[FrameOutput]) -> Result:
    """Score the tracks of a method."""
    tracks = recording.hypotheses(outputs)
    return Result(name, MarkScores(recording.truth, tracks, FPS), tracks)


def detections_alone(
    name: str, recording: MarkedRecording, outputs: Sequence[FrameOutput]
) -> Result:
    """Score the detections of a method without a tracker."""
    tracks = recording.detected(outputs)
    return Result(name, MarkScores(recording.truth, tracks, FPS), tracks, has_identity=False)


def in_frames(one: Result, frames: range) -> list[MarkOutcome]:
    """Return the outcomes of some frames."""
    return [outcome for outcome in one.scores.outcomes if outcome.frame in frames]


def summary_row(one: Result) -> list[str]:
    """Return all marks in one row."""
    scores, all_marks = one.scores, figures(one.scores.outcomes)
    row = [one.name, str(all_marks.found)]
    if not one.has_identity:
        return [*row, *["-"] * 8, known(all_marks.far), known(all_marks.facing)]
    idf1, hota = scores.idf1_hota(range(10_000))
    row += [str(all_marks.owned), str(all_marks.first), str(scores.id_switches)]
    row += [str(scores.takeovers), str(scores.invented), str(scores.ghosts)]
    row += [f"{100 * idf1:.1f}", f"{100 * hota:.1f}"]
    return [*row, known(all_marks.far), known(all_marks.facing)]


def known(share: Share) -> str:
    """Return a share as text, "-" of nothing."""
    return str(share) if share.total else "-"


def half_row(one: Result) -> list[str]:
    """Return found, right identities, IDF1, HOTA, position and facing of each half."""
    row = [one.name]
    for frames in HALVES.values():
        half = figures(in_frames(one, frames))
        idf1, hota = one.scores.idf1_hota(frames)
        row += [str(half.found.part)]
        shown = [o for o in in_frames(one, frames) if o.truth.mark.visibility != "mostly"]
        row += [str(half.owned.part), str(figures(shown).owned)]
        row += [f"{100 * idf1:.1f}", f"{100 * hota:.1f}"]
        row += [known(half.far), known(half.facing)]
    return row


def hidden_row(one: Result) -> list[str]:
    """Return found, right identity, position and facing by how much of a person is hidden."""
    row = [one.name]
    classes: list[Figures] = [
        figures([o for o in one.scores.outcomes if o.truth.mark.visibility == hidden])
        for hidden in HIDDEN
    ]
    for name in ("found", "owned", "far", "facing"):
        row += [known(getattr(one, name)) for one in classes]
    return row
