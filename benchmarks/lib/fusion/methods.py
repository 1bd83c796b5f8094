"""One tracker of all cameras beside one camera alone and a merger of tracks."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from benchmarks.lib.each import each
from benchmarks.lib.fusion.changes import nothing
from benchmarks.lib.fusion.run import TimedTracks, merge, track
from benchmarks.lib.fusion.scene import FusionScene
from benchmarks.lib.fusion.scores import FusionScore, errors_m, matched, rms_m, score_of, score_row
from people4d.messages import F64


def compare_methods(scenes: Sequence[FusionScene]) -> tuple[list[list[str]], str]:
    """Return rows of three methods, and of the last what becomes of identities after a gap."""
    results = each(_compared, scenes)
    names = ("one camera, the best", "four, nearest-neighbour merger", "four, one tracker")
    rows = []
    for k, name in enumerate(names):
        found, common_m = zip(*(scores[k] for scores, _ in results), strict=True)
        row = score_row([name], found)
        rows.append([*row[:5], f"{sum(common_m) / len(common_m):.3f}", *row[5:]])
    causes = sum((one.gap_causes for one in found), Counter[str]())
    counted = "; ".join(f"{cause}: {count}" for cause, count in causes.most_common())
    pairs = np.concatenate([pair for _, pairs in results for pair in pairs])
    alone_m, fused_m = np.sqrt((pairs**2).mean(axis=0))
    better = [
        bool(np.subtract(*(pair**2).mean(axis=0)) > 0) for _, pairs in results for pair in pairs
    ]
    return rows, (
        f"Each camera, not the best alone, in its own frames, {len(pairs)} positions of people: "
        f"alone {alone_m:.4f} m, one tracker {fused_m:.4f} m; better in {sum(better)} of "
        f"{len(better)} cameras and scenes.\n\nIdentities after a gap, one tracker: {counted}."
    )


def _compared(scene: FusionScene) -> tuple[list[tuple[FusionScore, float]], list[F64]]:
    """Return scores of three methods, with errors in frames of the best camera.

    Then errors (Nx2) of each camera alone, and of one tracker in its frames.
    """
    single = {name: track(scene, nothing, [name])[0] for name in scene.infos}
    alone = {name: errors_m(matched(scene, found)) for name, found in single.items()}
    best = min(alone, key=lambda name: rms_m(alone[name].values()) if alone[name] else np.inf)

    def in_frames_of(name: str, found: Sequence[TimedTracks]) -> dict[tuple[int, int], float]:
        times_ns = {timed.time_ns for timed in single[name]}
        errors = errors_m(matched(scene, [t for t in found if t.time_ns in times_ns]))
        return {key: error for key, error in errors.items() if key in alone[name]}

    fused, _ = track(scene, nothing)
    scores = [
        (score_of(scene, matched(scene, found)), rms_m(in_frames_of(best, found).values()))
        for found in (single[best], merge(single), fused)
    ]
    pairs = []
    for name, errors in alone.items():
        both = [(errors[key], error) for key, error in in_frames_of(name, fused).items()]
        if both:
            pairs.append(np.array(both))
    return scores, pairs
