"""People in recordings of real people, against marks made by hand: identity, position, facing.

The marks are in `real_people_marks/`; the recordings show identifiable people and are not part of
the repository: `--shared` names the folder that holds them. Sheets with marks and tracks go to
out/real_people/ and stay there. `--peers` names Python interpreters of environments that have the
packages to compare with; `lib/peers/mot.py` says how to make one.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from benchmarks.lib import options
from benchmarks.lib.marks.methods import HALF_FRAME, HALVES, MARKS, ROOT, variants
from benchmarks.lib.marks.recording import FrameOutput, MarkedRecording, marked, run
from benchmarks.lib.marks.results import (
    HALF_COLUMNS,
    HIDDEN_COLUMNS,
    SUMMARY_HEADER,
    Result,
    detections_alone,
    half_row,
    hidden_row,
    in_frames,
    known,
    result,
    summary_row,
)
from benchmarks.lib.marks.sheets import write_sheet
from benchmarks.lib.peers.run import PeerRun, PeerSequence, run_peers
from benchmarks.lib.table import markdown, write
from common.geometry.boxes import iou_xyxy
from evaluation.methods import read_method
from evaluation.recordings.hand_annotations import FPS, crossing_camera
from evaluation.recordings.hand_marks import HIDDEN, read_files, read_frames
from evaluation.recordings.mark_scores import (
    INVENTED_FRAMES,
    MarkOutcome,
    MarkScores,
    TrackedPerson,
    figures,
)
from people4d.messages import F64
from services.camera.config import CameraConfig
from services.detector.config import shipped_model

OUT = ROOT / "out" / "real_people"
SAME_BOX = 0.5  # least overlap of a track's box with that of its detection


def peer_results(
    python: str, name: str, recording: MarkedRecording, outputs: Sequence[FrameOutput]
) -> Iterator[Result]:
    """Yield trackers of boxes on the same detections, with own settings and with chosen ones."""
    rows = [
        (number, *map(float, d.box_xyxy_px), d.score)
        for number, one in enumerate(outputs, 1)
        for d in one.detections.detections
    ]
    sequence = PeerSequence(np.array(rows, np.float64), len(outputs), FPS)
    detected = recording.detected(outputs)
    for tracker, runs in run_peers(python, {"filinha": sequence}, {}).items():
        results = {}
        for number, one in runs.items():
            tracks = boxes_by_frame(one, detected)
            settings = "own settings" if number == 0 else one.settings.partition(": ")[2]
            label = f"{name}, {tracker}: {settings}"
            results[number] = Result(
                label, MarkScores(recording.truth, tracks, FPS), tracks, is_peer=True
            )
        yield results[0]
        best = max(results, key=lambda number: first_half_owned(results[number]))
        if best:
            yield results[best]


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
    """Return the position of the detection with the most of its box in common; None without."""
    if not detected:
        return None
    overlaps = iou_xyxy(box_xyxy_px, [one.box_xyxy_px for one in detected])[0]
    best = int(overlaps.argmax())
    return detected[best].position_m if overlaps[best] >= SAME_BOX else None


def first_half_owned(one: Result) -> int:
    """Return the marks of the first half with the right identity, by which settings are chosen."""
    return figures(in_frames(one, HALVES["first half"])).owned.part


def bag_rows(shared: Path) -> Iterator[list[str]]:
    """Yield a row for each model and each class of `hidden`, over the five bags."""
    marks = read_files(MARKS / "tue.json")
    pose = shared / "data" / "models" / "yolov8n-pose_640.onnx"
    models = {"MoveNet": (), "YOLOv8n-pose": (f"detector.model={pose}",)}
    for model, settings in models.items():
        outcomes = list[MarkOutcome]()
        for file, people in marks.items():
            source = shared / "data" / "rgbd" / "tue" / file
            camera = CameraConfig(source=str(source), playback="lockstep", window=1)
            recording, _ = marked(camera, {0: people})
            outputs = run(read_method("best", settings), camera, OUT)
            outcomes += detections_alone(model, recording, outputs).scores.outcomes
        for hidden in HIDDEN:
            some = figures([o for o in outcomes if o.truth.mark.visibility == hidden])
            yield [
                model,
                hidden,
                f"{some.found} of {some.found.total}",
                known(some.far),
                known(some.facing),
            ]


BAG_HEADER = ("model", "hidden", "found", "position > 0.5 m off", "facing within 45 deg")
SUMMARY_NOTE = (
    "108 RGB-D frames of six people who walk a loop through a room and hide each other; 10 frames "
    "a second are assumed. In {frames} of them all people are marked by eye in the images alone: "
    "{marks} marks, {no} of people who are not hidden, {partly} partly and {mostly} mostly. A "
    "track is on a mark if its box holds the mark or its position is within 0.5 m of the surface "
    "there, one to one; tracks with a detection come first, then the nearest on the ground (tracks "
    "of boxes count as where the detection in the box is), without depth in the image. "
    "`Right identity`: each person has one track over the recording, for the most marks. `First "
    "identity right`: the track is the person's first, and was no other's before. `Identity "
    "changes`: of people to another track; `taken over`: of tracks to another person. `Invented`: "
    "tracks with a detection on no marked person in more than {invented} frames. `Ghosts`: "
    "predicted tracks in the image on no marked person, over all frames. Marks have no extent: for "
    "IDF1 and HOTA a track is on a mark or not. Positions are compared on the ground with the "
    "surface at the mark, where depths around it are of one body; yaws relative to the line of "
    "sight, of found people. Percentages are of the marks to which "
    "the figure applies. Trackers of other packages get the same boxes and "
    "scores, and publish boxes only; their chosen settings (all of PEERS in peers/mot.py were "
    "run) have the most right identities in the first half. The thresholds of some are "
    "above most of MoveNet's scores. All others run as shipped. MoveNet is {movenet}, the default "
    "on this processor."
)
HALF_NOTE = (
    "Frames before {split} ({first} marks) are for choosing, the others ({second} marks) for "
    "testing. Identities are assigned over the joint recording. `Less hidden`: right identities of "
    "people who are not mostly hidden."
)
OTHER_NOTE = (
    "56 people in 19 of the frames, marked by another person; tracks between these frames count "
    "for nothing."
)
BAG_NOTE = (
    "Five frames of single images (TUE), most people behind a desk in the background. Detections "
    "alone; the camera is taken to be level."
)


def report(
    results: Sequence[Result],
    compared: Sequence[Sequence[str]],
    bags: Sequence[Sequence[str]],
    recording: MarkedRecording,
) -> None:
    """Print and write all tables."""
    marks = [truth.mark for people in recording.truth.values() for truth in people]
    counts = {hidden: sum(m.visibility == hidden for m in marks) for hidden in HIDDEN}
    by_half = [
        sum(len(recording.truth[f]) for f in recording.truth if f in h) for h in HALVES.values()
    ]
    tracked = [one for one in results if one.has_identity]
    halves = [f"{name}: {column}" for name in HALVES for column in HALF_COLUMNS]
    classes = [f"{name}, {hidden} hidden" for name in HIDDEN_COLUMNS for hidden in HIDDEN]
    numbers = SUMMARY_NOTE.format(
        movenet=shipped_model(),
        frames=len(recording.truth),
        marks=len(marks),
        invented=INVENTED_FRAMES,
        **counts,
    )
    write(
        __file__,
        "Real people against marks made by hand",
        numbers,
        markdown(SUMMARY_HEADER, [summary_row(one) for one in results]),
        "## By half\n\n" + HALF_NOTE.format(split=HALF_FRAME, first=by_half[0], second=by_half[1]),
        markdown(["method", *halves], [half_row(one) for one in tracked]),
        "## By how much is hidden",
        markdown(["method", *classes], [hidden_row(one) for one in results if not one.is_peer]),
        "## Other marks\n\n" + OTHER_NOTE,
        markdown(SUMMARY_HEADER, compared),
        "## Single images\n\n" + BAG_NOTE,
        markdown(BAG_HEADER, bags),
    )


def main() -> None:
    """Measure, write the tables, draw the sheets."""
    parser = options.parser(__doc__, "shared")
    parser.add_argument("--peers", nargs="*", default=[], help="interpreters with other packages")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    camera = crossing_camera(arguments.shared)
    recording, images = marked(camera, read_frames(MARKS / "filinha.json"))
    other, _ = marked(camera, read_frames(Path(camera.source) / "marks.json"))
    results, compared = list[Result](), list[list[str]]()
    for variant in variants(arguments.shared):
        outputs = run(variant.method(), camera, OUT)
        one = result(variant.name, recording, outputs)
        results.append(one)
        compared.append(summary_row(result(variant.name, other, outputs)))
        print(*summary_row(one), sep=" | ", flush=True)
        if variant.draws:
            write_sheet(OUT / f"{variant.name}.png", images, one.hypotheses, one.scores)
        if variant.detector:
            alone = f"{variant.detector}, detections alone"
            results.append(detections_alone(alone, recording, outputs))
            for python in arguments.peers:
                results += peer_results(python, variant.detector, recording, outputs)
    report(results, compared, list(bag_rows(arguments.shared)), recording)
