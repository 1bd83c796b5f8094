"""Real people in variations of one recording: mirrored, dark, blurred, backwards, at half the rate.

One recording has a few difficult moments, and one decision more or less changes all its figures.
Each variation gives other detections, appearances or gaps at the same moments. `--shared` names the
folder that holds the recording; see real_people.py. `--set` changes settings, and writes nothing.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2

from benchmarks.lib import options
from benchmarks.lib.marks.methods import HALVES, MARKS, Variant, variants
from benchmarks.lib.marks.recording import MarkedRecording, marked
from benchmarks.lib.marks.variations import (
    IMAGES,
    ORDERS,
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
from evaluation.methods import Method
from evaluation.recordings.detection_cache import DetectionCache
from evaluation.recordings.hand_annotations import FPS, crossing_camera
from evaluation.recordings.hand_marks import read_frames
from evaluation.recordings.mark_scores import MarkOutcome, MarkScores, Share, figures
from services.camera.source import SourceFrame
from services.detector.config import shipped_model

EMBEDDERS = 6  # the first variants: three embedders on two detectors
COLUMNS = ("right identity", "worst", "off", "facing")
HEADER = (
    "method",
    *(f"{half}: {name}" for half in HALVES for name in COLUMNS),
    *("identity changes", "taken over"),
)
NOTE = (
    "The recording of [real_people](real_people.md) in {count} variations: images {images}; each "
    "with {orders}. Half the frames come at half the rate. `Right identity`: marks of people less "
    "than half hidden, all variations together; `worst`: in the worst one. `Off`: positions more "
    "than 0.5 m off. `Facing`: within 45 degrees, not backwards. Frames before 54 are for "
    "choosing. Variations share their difficult moments: they show how much of a figure is luck, "
    "not how other people would fare. MoveNet is {movenet}, the default on this processor."
)


@dataclass(frozen=True)
class VariationScores:
    """Scores of one method in one variation."""

    images: ImageVariation
    order: OrderVariation
    scores: MarkScores
    frames: Mapping[int, int]  # of the recording, by position in the order

    def outcomes(self, half: range) -> list[MarkOutcome]:
        """Return the outcomes of marks in a half of the recording."""
        return [o for o in self.scores.outcomes if self.frames[o.frame] in half]

    def owned(self, half: range) -> Share:
        """Return the right identities of people less than half hidden."""
        shown = [o for o in self.outcomes(half) if o.truth.mark.visibility != "mostly"]
        return figures(shown).owned


def score(
    method: Method,
    recording: MarkedRecording,
    images: Sequence[SourceFrame],
    caches: Sequence[DetectionCache],
) -> list[VariationScores]:
    """Return the scores of a method in all variations."""
    results = list[VariationScores]()
    for variation, cache in zip(IMAGES, caches, strict=True):
        view = vary(recording, variation).view
        detections = detect(method, view, images, variation, cache)
        results += score_detected(method, recording, variation, detections)
    return results


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
    """Return shares put together."""
    return Share(sum(s.part for s in shares), sum(s.total for s in shares))


def percent(share: Share) -> str:
    """Return a share in percent, "-" of nothing."""
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
    """Measure and write the tables."""
    parser = options.parser(__doc__, "shared")
    parser.add_argument("--set", nargs="*", default=[], help="settings, as of people4d evaluate")
    parser.add_argument("--only", default="", help="part of the names of methods")
    asked = parser.parse_args()
    cv2.setNumThreads(1)
    camera = crossing_camera(asked.shared)
    recording, images = marked(camera, read_frames(MARKS / "filinha.json"))
    lines, by_variation = list[list[str]](), list[list[str]]()
    caches = dict[str, list[DetectionCache]]()
    for variant in chosen(asked.shared, asked.only, asked.set):
        method = variant.method()
        cache = caches.setdefault(method.detector.model, [DetectionCache() for _ in IMAGES])
        results = score(method, recording, images, cache)
        lines.append(row(variant.name, results))
        print(*lines[-1], sep=" | ", flush=True)
        if not by_variation:
            parts = {i.name: [r for r in results if r.images is i] for i in IMAGES}
            parts |= {o.name: [r for r in results if r.order is o] for o in ORDERS}
            by_variation = [row(name, part) for name, part in parts.items()]
    if asked.set or asked.only:
        return
    note = NOTE.format(
        movenet=shipped_model(),
        count=len(IMAGES) * len(ORDERS),
        images="; ".join(i.name for i in IMAGES),
        orders="; ".join(o.name for o in ORDERS),
    )
    write(
        __file__,
        "Real people in variations of a recording",
        note,
        markdown(HEADER, lines),
        "## The default, by variation",
        markdown(("variation", *HEADER[1:]), by_variation),
    )


def chosen(shared: Path, only: str, settings: Sequence[str]) -> list[Variant]:
    """Return the methods with changed settings."""
    first = [one for one in variants(shared)[:EMBEDDERS] if only in one.name]
    return [replace(one, settings=(*one.settings, *settings)) for one in first]
