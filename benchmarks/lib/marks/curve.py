"""People found and false people, by the minimum score of detections."""

from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.lib.marks.crossing import crossing_camera
from benchmarks.lib.marks.methods import HALVES, MARKS
from benchmarks.lib.marks.recording import marked
from benchmarks.lib.marks.scores import figures
from benchmarks.lib.marks.variations import IMAGES, detect, vary
from benchmarks.real_variations import score_detected
from evaluation.annotations.marks import read_frames
from evaluation.methods import read_method

LIMITS = (0.05, 0.2, 0.4, 0.6)  # minimum scores; MoveNet's is 0.05
HEADER = (
    "minimum score",
    *("heavily occluded: found", "correct identity"),
    *("other people: found", "correct identity"),
    "false tracks, an hour",
)


def curve_rows(shared: Path, false_tracks: Callable[[str], str]) -> Iterator[list[str]]:
    """Yield a row for each limit: annotated real people of the test split, and false people.

    Args:
        shared: Folder of the recording.
        false_tracks: Returns the rate of false tracks with a setting.
    """
    camera = crossing_camera(shared)
    recording, images = marked(camera, read_frames(MARKS / "filinha.json"))
    _, test = HALVES.values()
    for limit in LIMITS:
        setting = f"detector.score_min={limit}"
        method = read_method("best", (setting,))
        outcomes = [
            outcome
            for variation in IMAGES
            for one in score_detected(
                method,
                recording,
                variation,
                detect(method, vary(recording, variation).view, images, variation, {}),
            )
            for outcome in one.outcomes(test)
        ]
        cells = [f"{limit:g}"]
        for is_heavy in (True, False):
            chosen = [o for o in outcomes if (o.truth.mark.hidden == "mostly") == is_heavy]
            cells += [str(figures(chosen).found), str(figures(chosen).owned)]
        yield [*cells, false_tracks(setting)]
