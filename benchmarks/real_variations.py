"""Annotated real people in augmented images, in other orders and at half the rate.

A recording has few difficult moments, and one decision changes all its figures. Augmentations give
other detections, appearances or gaps at the same moments. `--shared` names the folder of the
recording, see scoreboard.py.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from benchmarks.lib import options
from benchmarks.lib.marks.crossing import FPS, crossing_camera
from benchmarks.lib.marks.methods import HALVES, MARKS, variants
from benchmarks.lib.marks.recording import MarkedRecording, marked
from benchmarks.lib.marks.scores import MarkOutcome, MarkScores, Share, figures
from benchmarks.lib.marks.variations import (
    IMAGES,
    ORDERS,
    Cache,
    ImageVariation,
    OrderVariation,
    VariedDetections,
    detect,
    in_order,
    track,
    vary,
)
from benchmarks.lib.table import markdown, write
from common.metrics.counts import ratio
from evaluation.annotations.marks import read_frames
from evaluation.methods import Method
from services.detector.config import shipped_model

EMBEDDERS = 6  # the first variants: three embedders on two detectors
COLUMNS = ("correct identity", "worst", "off", "yaw")
HEADER = (
    "method",
    *(f"{split}: {name}" for split in ("tuning", "test") for name in COLUMNS),
    *("switches", "taken over"),
)
NOTE = (
    "Recording filinha of [scoreboard](scoreboard.md) in {count} augmentations: images {images}; "
    "each with {orders}. Half the frames come at half the rate. `Correct identity`: annotations "
    "of people not heavily occluded, all augmentations together; `worst`: in the worst one. "
    "`Off`: positions more than 0.5 m off. `Yaw`: within 45 degrees, not backwards. Frames before "
    "54 are the tuning split. Augmentations share their difficult moments: they show the part of "
    "chance in a figure, not how the tracker generalises. MoveNet is {movenet}, the default on "
    "this processor."
)


@dataclass(frozen=True)
class VariationScores:
    """Scores of one method in one variation."""

    images: ImageVariation
    order: OrderVariation
    scores: MarkScores
    frames: Mapping[int, int]  # frame of the recording by position in the order

    def outcomes(self, half: range) -> list[MarkOutcome]:
        """Return the outcomes of marks in a half of the recording."""
        return [o for o in self.scores.outcomes if self.frames[o.frame] in half]

    def owned(self, half: range) -> Share:
        """Return the correct identities of people less than half occluded."""
        shown = [o for o in self.outcomes(half) if o.truth.mark.hidden != "mostly"]
        return figures(shown).owned


def score_detected(
    method: Method,
    recording: MarkedRecording,
    variation: ImageVariation,
    detections: VariedDetections,
) -> Iterator[VariationScores]:
    """Yield the scores of a method on varied images in all orders."""
    varied = vary(recording, variation)
    for order in ORDERS:
        outputs = list(track(method, detections, order))
        part, frames = in_order(varied, outputs)
        tracks = part.hypotheses([output for _, output in outputs])
        yield VariationScores(variation, order, MarkScores(part.truth, tracks, FPS), frames)


def total(shares: Sequence[Share]) -> Share:
    """Return the sum of shares."""
    return Share(sum(s.part for s in shares), sum(s.total for s in shares))


def percent(share: Share) -> str:
    """Return a share in percent, "-" for an empty total."""
    return f"{100 * ratio(share.part, share.total):.1f} %" if share.total else "-"


def row(name: str, results: Sequence[VariationScores]) -> list[str]:
    """Return all variations of a method in one row."""
    cells = [name]
    for half in HALVES.values():
        owned = [one.owned(half) for one in results]
        known = [s for s in owned if s.total]
        every = [figures(one.outcomes(half)) for one in results]
        forward = [f for f, one in zip(every, results, strict=True) if not one.order.reversed]
        cells += [percent(total(owned)), percent(min(known, key=lambda s: s.part / s.total))]
        cells += [str(total([f.far for f in every])), percent(total([f.facing for f in forward]))]
    changes = sum(one.scores.id_switches for one in results)
    return [*cells, str(changes), str(sum(one.scores.takeovers for one in results))]


def main() -> None:
    """Measure and write the table."""
    asked = options.parser(__doc__, "shared").parse_args()
    camera = crossing_camera(asked.shared)
    recording, images = marked(camera, read_frames(MARKS / "filinha.json"))
    lines, caches = list[list[str]](), dict[str, list[Cache]]()
    for variant in variants(asked.shared)[:EMBEDDERS]:
        method = variant.method()
        cached = caches.setdefault(method.detector.model, [{} for _ in IMAGES])
        results = [
            one
            for variation, cache in zip(IMAGES, cached, strict=True)
            for one in score_detected(
                method,
                recording,
                variation,
                detect(method, vary(recording, variation).view, images, variation, cache),
            )
        ]
        lines.append(row(variant.name, results))
    note = NOTE.format(
        movenet=shipped_model(),
        count=len(IMAGES) * len(ORDERS),
        images="; ".join(i.name for i in IMAGES),
        orders="; ".join(o.name for o in ORDERS),
    )
    write(__file__, "Annotated real people in augmentations", note, markdown(HEADER, lines))
