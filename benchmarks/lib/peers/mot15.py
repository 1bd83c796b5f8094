"""The MOT15 sequences: public detections, truth and scores of tracks."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.metrics.mot_text import MotInfo, MotRows, read_info, read_rows, sequence
from common.metrics.record import Hypotheses
from common.metrics.scores import Scores, combine, score
from common.metrics.similarity import box_overlap
from people4d.messages import F64
from services.tracker.image_sort.image_sort import BoxFrame, BoxTracks

# Tuning split: a moving camera and a static one
TUNING = ("ETH-Bahnhof", "TUD-Stadtmitte")
HELD_OUT = ("ADL-Rundle-6", "KITTI-17", "TUD-Campus")


@dataclass(frozen=True)
class MotSequence:
    """One sequence."""

    info: MotInfo
    truth: MotRows
    frames: tuple[BoxFrame, ...]

    @property
    def rows(self) -> F64:
        """The detections: frame, left, top, right, bottom, score."""
        return np.vstack(
            [
                np.column_stack([np.full(len(f.scores), number), f.boxes_xyxy_px, f.scores])
                for number, f in enumerate(self.frames, 1)
            ]
        )


def load(folder: Path) -> MotSequence:
    """Read one sequence."""
    info, found = read_info(folder / "seqinfo.ini"), read_rows(folder / "det" / "det.txt")
    frames = []
    for number in range(1, info.frames + 1):
        rows, stamp_ns = found.of(number), round((number - 1) * 1e9 / info.rate_hz)
        size_px = info.width, info.height
        frames.append(BoxFrame(stamp_ns, rows.boxes_xyxy_px, rows.confidences, size_px))
    return MotSequence(info, read_rows(folder / "gt" / "gt.txt"), tuple(frames))


def load_all(shared: Path) -> dict[str, MotSequence]:
    """Read the five sequences."""
    folder = shared / "data" / "mot15"
    return {name: load(folder / name) for name in (*TUNING, *HELD_OUT)}


def score_tracks(one: MotSequence, tracks: Sequence[BoxTracks]) -> Scores:
    """Score the tracks of a sequence, frame by frame."""
    people = {
        number: Hypotheses(ids=tuple(t.ids.tolist()), boxes_xyxy_px=t.boxes_xyxy_px)
        for number, t in enumerate(tracks, 1)
    }
    return score(sequence(one.info, one.truth, people), box_overlap)


def quality(scores: Iterable[Scores]) -> float:
    """Return the mean over sequences of MOTA + IDF1 + HOTA, the criterion of settings."""
    rows = [one.row() for one in scores]
    return float(np.mean([sum(row[key] or 0 for key in ("mota", "idf1", "hota")) for row in rows]))


def cells(scores: Iterable[Scores]) -> list[str]:
    """Return MOTA, IDF1 and HOTA in percent, and ID switches, of sequences together."""
    row = combine(scores).row()
    shares = [f"{100 * (row[key] or 0):.1f}" for key in ("mota", "idf1", "hota")]
    return [*shares, f"{row['id_switches']:.0f}"]
