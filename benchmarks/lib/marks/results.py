"""Results of methods on annotated real people, and their rows in tables."""

from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.lib.marks.annotations import HIDDEN
from benchmarks.lib.marks.crossing import FPS
from benchmarks.lib.marks.recording import FrameOutput, MarkedRecording
from benchmarks.lib.marks.scores import (
    Figures,
    MarkScores,
    Share,
    figures,
)

SUMMARY_HEADER = (
    *("method", "found", "correct identity", "first identity correct", "switches"),
    *("taken over", "invented", "ghosts", "IDF1 %", "HOTA %"),
    *("position > 0.5 m off", "yaw within 45 deg"),
)
HIDDEN_COLUMNS = ("found", "correct identity", "position off", "yaw")
HIDDEN_TITLES = ("not", "partly", "heavily")


@dataclass(frozen=True)
class Result:
    """One method on a recording."""

    name: str
    scores: MarkScores
    has_identity: bool = True  # False: detections alone
    is_peer: bool = False  # True: a tracker of another package


def result(name: str, recording: MarkedRecording, outputs: Sequence[FrameOutput]) -> Result:
    """Score the tracks of a method."""
    tracks = recording.hypotheses(outputs)
    return Result(name, MarkScores(recording.truth, tracks, FPS))


def detections_alone(
    name: str, recording: MarkedRecording, outputs: Sequence[FrameOutput]
) -> Result:
    """Score the detections of a method without a tracker."""
    tracks = recording.detected(outputs)
    return Result(name, MarkScores(recording.truth, tracks, FPS), has_identity=False)


def summary_row(one: Result) -> list[str]:
    """Return the figures of all annotations in one row."""
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
    """Return a share as text, "-" if its total is 0."""
    return str(share) if share.total else "-"


def hidden_row(one: Result) -> list[str]:
    """Return found, correct identity, position and yaw by occlusion."""
    row = [one.name]
    classes: list[Figures] = [
        figures([o for o in one.scores.outcomes if o.truth.mark.hidden == hidden])
        for hidden in HIDDEN
    ]
    for name in ("found", "owned", "far", "facing"):
        row += [known(getattr(one, name)) for one in classes]
    return row
