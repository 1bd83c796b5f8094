"""Identity, position and yaw of annotated real people, compared with other packages.

The annotations are in `real_people_marks/`. The recordings show identifiable people and are not
published: `--shared` names their folder. `--peers` names Python interpreters of environments with
other packages, see `lib/peers/mot.py`.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from benchmarks.lib import options
from benchmarks.lib.marks.annotations import HIDDEN, read_frames
from benchmarks.lib.marks.crossing import FPS, crossing_camera
from benchmarks.lib.marks.methods import HALF_FRAME, HALVES, MARKS, ROOT, variants
from benchmarks.lib.marks.recording import FrameOutput, MarkedRecording, marked, run
from benchmarks.lib.marks.results import (
    HIDDEN_COLUMNS,
    HIDDEN_TITLES,
    SUMMARY_HEADER,
    Result,
    detections_alone,
    hidden_row,
    result,
    summary_row,
)
from benchmarks.lib.marks.scores import (
    INVENTED_FRAMES,
    MarkScores,
    TrackedPerson,
    figures,
)
from benchmarks.lib.peers.run import PeerRun, PeerSequence, run_peers
from benchmarks.lib.table import markdown, write
from common.geometry.boxes import iou_xyxy
from people4d.messages import F64
from services.detector.config import shipped_model

OUT = ROOT / "out" / "real_people"
SAME_BOX = 0.5  # minimum overlap of the boxes of a track and its detection


def peer_results(
    python: str, name: str, recording: MarkedRecording, outputs: Sequence[FrameOutput]
) -> Iterator[Result]:
    """Yield each tracker of boxes on the same detections, with the best settings.

    Settings are chosen by the correct identities in the tuning split.
    """
    rows = [
        (number, *map(float, d.box_xyxy_px), d.score)
        for number, one in enumerate(outputs, 1)
        for d in one.detections.detections
    ]
    sequence = PeerSequence(np.array(rows, np.float64), len(outputs), FPS)
    detected = recording.detected(outputs)
    for tracker, runs in run_peers(python, {"filinha": sequence}, {}).items():
        results = []
        for number, one in runs.items():
            tracks = boxes_by_frame(one, detected)
            settings = "own settings" if number == 0 else one.settings.partition(": ")[2]
            label = f"{name}, {tracker}: {settings}"
            scores = MarkScores(recording.truth, tracks, FPS)
            results.append(Result(label, scores, is_peer=True))
        yield max(results, key=tuning_owned)


def boxes_by_frame(
    one: PeerRun, detected: Mapping[int, Sequence[TrackedPerson]]
) -> dict[int, list[TrackedPerson]]:
    """Return the tracks of another package, frames from 0, with positions of detections."""
    tracks = dict[int, list[TrackedPerson]]()
    for number, identity, *corners in one.rows["filinha"].tolist():
        frame, box = int(number) - 1, np.array(corners)
        position_m = position_in(box, detected[frame])
        tracks.setdefault(frame, []).append(
            TrackedPerson(int(identity), box, detected_m=position_m)
        )
    return tracks


def position_in(box_xyxy_px: F64, detected: Sequence[TrackedPerson]) -> F64 | None:
    """Return the position of the detection with the largest overlap of boxes; None if none."""
    if not detected:
        return None
    overlaps = iou_xyxy(box_xyxy_px, [one.box_xyxy_px for one in detected])[0]
    best = int(overlaps.argmax())
    return detected[best].position_m if overlaps[best] >= SAME_BOX else None


def tuning_owned(one: Result) -> int:
    """Return the correct identities in the tuning split."""
    tuning = [o for o in one.scores.outcomes if o.frame in HALVES["first half"]]
    return figures(tuning).owned.part


SUMMARY_NOTE = (
    "108 RGB-D frames of six people who walk a loop through a room and occlude each other, taken "
    "as 10 frames a second. {frames} frames are annotated by hand in the images alone: {marks} "
    "annotations, {no} of people without occlusion, {partly} partly and {mostly} heavily "
    "occluded. A track matches an annotation if its box contains it or its position is within "
    "0.5 m of the surface there, one to one. Tracks with a detection come first, then the nearest "
    "on the ground, without depth the nearest in the image. `Correct identity`: each person has "
    "one track over the recording, the one with the most annotations. `First identity correct`: "
    "the track is the person's first, and was no other person's before. `Switches`: a person gets "
    "another track; `taken over`: a track goes to another person. `Invented`: tracks with a "
    "detection on no annotated person in more than {invented} frames. `Ghosts`: predicted tracks "
    "in the image on no annotated person, over all frames. Positions are compared with the "
    "surface at the annotation, yaws relative to the line of sight. Percentages are of the "
    "annotations to which the figure applies. Trackers of other packages get the same boxes and "
    "scores, and publish boxes only; each has the settings, of those in peers/mot.py, with the "
    "most correct identities before frame {split}. All other methods run as shipped. MoveNet is "
    "{movenet}, the default on this processor."
)


def main() -> None:
    """Measure and write the tables."""
    parser = options.parser(__doc__, "shared")
    parser.add_argument("--peers", nargs="*", default=[], help="interpreters with other packages")
    arguments = parser.parse_args()
    camera = crossing_camera(arguments.shared)
    recording, _ = marked(camera, read_frames(MARKS / "filinha.json"))
    results = list[Result]()
    for variant in variants(arguments.shared):
        outputs = run(variant.method(), camera, OUT)
        results.append(result(variant.name, recording, outputs))
        if variant.detector:
            alone = f"{variant.detector}, detections alone"
            results.append(detections_alone(alone, recording, outputs))
            for python in arguments.peers:
                results += peer_results(python, variant.detector, recording, outputs)
    marks = [truth.mark for people in recording.truth.values() for truth in people]
    note = SUMMARY_NOTE.format(
        movenet=shipped_model(),
        frames=len(recording.truth),
        marks=len(marks),
        invented=INVENTED_FRAMES,
        split=HALF_FRAME,
        **{hidden: sum(m.hidden == hidden for m in marks) for hidden in HIDDEN},
    )
    classes = [f"{name}, {hidden} occluded" for name in HIDDEN_COLUMNS for hidden in HIDDEN_TITLES]
    write(
        __file__,
        "Annotated real people",
        note,
        markdown(SUMMARY_HEADER, [summary_row(one) for one in results]),
        "## By occlusion",
        markdown(["method", *classes], [hidden_row(one) for one in results if not one.is_peer]),
    )
