"""The virtual lab: what a frame costs, and whether networks trained on photographs see people."""

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from benchmarks.lib.lab_frames import LabFrame, is_alone, lab_frames
from benchmarks.lib.table import markdown, spread, write
from common.geometry.boxes import iou_xyxy
from evaluation.recordings.rendered import has_to_be_found, inside
from lab.camera.frames import FrameRenderer, RenderSettings
from lab.camera.synthetic_detections import SyntheticDetections, SyntheticDetectionsConfig
from lab.catalogue import load_scenario
from lab.truth.frames import PersonView
from lab.world import World
from people4d.messages import F32, F64, U8
from services.detector.config import DetectorConfig, ModelSettings
from services.detector.models.base import DetectedPerson, PersonModel
from services.detector.models.registry import load_model

MODELS = Path(__file__).resolve().parents[2] / "shared" / "data" / "models"
COST_SCENARIOS = ("short_walk", "crossing", "four_dense")
COST_FRAMES = 12
ROUNDS = 5
SCENARIOS = ("two_crossing", "three_crossing", "four_dense", "pmrm2", "crossing")
FRAMES = 40  # of each scenario
IOU_MIN = 0.5  # overlap of a box found with a person's
INSIDE_MIN = 0.5  # share of a box that lies on somebody, from which it is no false alarm
MIRRORED = [0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15]  # COCO: left and right
POINTS = {
    "head": slice(0, 5),
    "shoulders": slice(5, 7),
    "elbows, wrists": slice(7, 11),
    "hips": slice(11, 13),
    "knees": slice(13, 15),
    "ankles": slice(15, 17),
}


@dataclass
class Tally:
    """Results of a model in all images."""

    confidence_min: float  # of a keypoint that counts
    frames: int = 0
    alone: list[bool] = field(default_factory=list)  # found, of the people that nothing hides
    hidden: list[bool] = field(default_factory=list)  # found, of the people partly hidden
    false_alarms: int = 0  # boxes on no person, and second boxes on one person
    unmatched: int = 0  # boxes that match no person well enough, false alarms included
    errors_px: list[F64] = field(default_factory=list)  # 17 each, NaN where not seen
    swapped: int = 0  # people whose shoulders are seen and taken one for the other
    facing: int = 0  # people whose shoulders are seen far apart


def score_frame(frame: LabFrame, found: Sequence[DetectedPerson], tally: Tally) -> None:
    """Score the people that a model found in an image against the truth.

    Greedy by score. A box that lies on somebody but fits badly, as on the visible part of a
    person behind another, is unmatched but no false alarm.
    """
    size = (frame.rgb.shape[0], frame.rgb.shape[1])
    people = [p for p in frame.people if p.visible_share > 0]
    boxes = np.array([p.box_xyxy_px for p in people]).reshape(-1, 4)
    matched: dict[int, DetectedPerson] = {}
    for person in sorted(found, key=lambda p: -p.score):
        overlap = iou_xyxy([person.box_xyxy_px], boxes)[0]
        overlap[list(matched)] = -1.0
        if len(overlap) and overlap.max() >= IOU_MIN:
            matched[int(overlap.argmax())] = person
        else:
            tally.unmatched += 1
            free = np.delete(boxes, list(matched), axis=0)
            tally.false_alarms += int(covered(person.box_xyxy_px, free) < INSIDE_MIN)
    tally.frames += 1
    for k, truth in enumerate(people):
        if is_alone(truth, size):
            tally.alone.append(k in matched)
            if k in matched:
                compare_keypoints(truth, matched[k], tally, size)
        elif has_to_be_found(truth, size):
            tally.hidden.append(k in matched)


def covered(box: F32, by: F64) -> float:
    """Return the largest share of a box that one of N others covers, corner format."""
    sides = np.minimum(by[:, 2:], box[2:]) - np.maximum(by[:, :2], box[:2])
    shared = np.prod(np.maximum(sides, 0.0), axis=1)
    return float(np.max(shared, initial=0.0) / np.prod(box[2:] - box[:2]))


def compare_keypoints(
    truth: PersonView, found: DetectedPerson, tally: Tally, size: tuple[int, int]
) -> None:
    """Note the error of each keypoint that is seen and found."""
    if found.keypoints is None:
        return
    errors = np.linalg.norm(found.keypoints[:, :2] - truth.keypoints_px, axis=1)
    use = (truth.visible > 0) & (inside(truth, size) > 0)
    errors[~use | (found.keypoints[:, 2] < tally.confidence_min)] = np.nan
    tally.errors_px.append(errors)
    wide = truth.keypoints_px[5] - truth.keypoints_px[6]
    if abs(wide[0]) > 20 and use[[5, 6]].all():
        tally.facing += 1
        visible = found.keypoints[5] - found.keypoints[6]
        tally.swapped += int(visible[0] * wide[0] < 0)


def share(found: Sequence[bool]) -> str:
    """Return counts and their ratio, as text."""
    return f"{sum(found)} of {len(found)} = {np.mean(found):.3f}" if found else "none"


def model_row(name: str, tally: Tally) -> list[str]:
    """Return one line of the table of models."""
    errors = np.array(tally.errors_px).reshape(-1, 17)
    visible = errors[np.isfinite(errors)]
    parts = [
        f"{np.nanmedian(errors[:, part]):.1f}" if len(visible) else "" for part in POINTS.values()
    ]
    return [
        name,
        share(tally.alone),
        share(tally.hidden),
        f"{tally.false_alarms / tally.frames:.3f}",
        f"{tally.unmatched / tally.frames:.3f}",
        f"{np.median(visible):.1f} / {np.percentile(visible, 90):.1f}" if len(visible) else "",
        " / ".join(parts),
        f"{tally.swapped} of {tally.facing}",
    ]


class Mirrored:
    """Finds keypoints in a picture and in its mirror image, and gives their mean.

    What a network does worse on one side than on the other is halved.

    Args:
        model: The network, with keypoints.
    """

    def __init__(self, model: PersonModel) -> None:
        self.name = model.name
        self._model = model

    def detect(self, rgb: U8) -> list[DetectedPerson]:
        """Return the people found in the picture, keypoints improved by its mirror image."""
        width = rgb.shape[1]
        mirrored = self._model.detect(np.ascontiguousarray(rgb[:, ::-1]))
        turned = [_turn(person, width) for person in mirrored]
        return [_mean(person, turned) for person in self._model.detect(rgb)]


def _turn(person: DetectedPerson, width: int) -> DetectedPerson:
    """Return a person found in a mirror image as seen in the picture."""
    left, top, right, bottom = person.box_xyxy_px
    box = np.array([width - 1 - right, top, width - 1 - left, bottom], np.float32)
    if person.keypoints is None:
        return DetectedPerson(person.score, box)
    keypoints = person.keypoints[MIRRORED]
    keypoints[:, 0] = width - 1 - keypoints[:, 0]
    return DetectedPerson(person.score, box, keypoints)


def _mean(person: DetectedPerson, others: Sequence[DetectedPerson]) -> DetectedPerson:
    """Return a person with the mean of its keypoints and those of the same box among others."""
    same = [o for o in others if iou_xyxy([o.box_xyxy_px], [person.box_xyxy_px])[0, 0] > IOU_MIN]
    if not same or person.keypoints is None or same[0].keypoints is None:
        return person
    keypoints: F32 = (person.keypoints + same[0].keypoints) / np.float32(2)
    return DetectedPerson(person.score, person.box_xyxy_px, keypoints)


def models() -> dict[str, PersonModel]:
    """Return the models by name; those that are absent are left out."""
    loaded = {"movenet-multipose (ships)": load_model(ModelSettings())}
    for name in ("yolov8n-pose", "yolov8n-seg"):
        path = MODELS / f"{name}_640.onnx"
        if path.exists():
            loaded[name] = load_model(ModelSettings(model=str(path)))
    if "yolov8n-pose" in loaded:
        mirrored = Mirrored(loaded["yolov8n-pose"])
        loaded["yolov8n-pose, mean with the mirror image"] = mirrored
    return loaded


def cost_rows() -> list[list[str]]:
    """Return milliseconds a frame of the three fidelities, for each scenario."""
    rows = []
    for name in COST_SCENARIOS:
        world = World(load_scenario(name))
        people = len(world.scenario.people)
        step = world.frame_count // COST_FRAMES
        indices = list(range(0, world.frame_count, max(step, 1)))[:COST_FRAMES]
        cells = [
            spread([timed(render, indices) for _ in range(ROUNDS)], "{:.1f}")
            for render in renderers(world)
        ]
        rows.append([name, str(people), *cells])
    return rows


def renderers(world: World) -> list[Callable[[int], object]]:
    """Return a renderer of frames at each fidelity, with one and two threads where it uses them."""
    detections = SyntheticDetections(SyntheticDetectionsConfig(), world.info, world.seed)

    def visible(index: int) -> object:
        t_s = world.frame_s(index)
        people = world.keypoints_m(t_s)
        return detections.at(people, world.optical_from_map(t_s), world.stamp_ns(index))

    settings = [
        replace(setting, threads=threads)
        for setting in (
            RenderSettings(colour="flat"),
            RenderSettings(samples=1),
            RenderSettings(samples=2),
        )
        for threads in (1, 2)
    ]
    return [visible, *(FrameRenderer(world, setting).capture for setting in settings)]


def timed(render: Callable[[int], object], indices: Sequence[int]) -> float:
    """Return the mean time of a frame in milliseconds."""
    begin = time.perf_counter()
    for index in indices:
        render(index)
    return (time.perf_counter() - begin) * 1e3 / len(indices)


def main() -> None:
    """Measure and write the tables."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    cost = cost_rows()
    frames = [frame for name in SCENARIOS for frame in lab_frames(name, FRAMES)]
    rows = []
    for name, model in models().items():
        tally = Tally(DetectorConfig().keypoints_for(model.name).confidence_min)
        for frame in frames:
            score_frame(frame, model.detect(frame.rgb), tally)
        rows.append(model_row(name, tally))
    write(
        __file__,
        "The virtual lab",
        "## Cost of a frame",
        f"Milliseconds a frame, 640x480, mean over {COST_FRAMES} frames spread over the scenario, "
        f"median (least to most) of {ROUNDS} rounds; depth and colour include the depth sensor.",
        markdown(COST_HEADER, cost),
        "## Do networks see people?",
        f"{len(frames)} pictures ({FRAMES} each of {', '.join(SCENARIOS)}). A person has to be "
        "found where face and trunk lie inside the image and at least 35 % of the body is seen; "
        "in full view: at least 90 %. Found: IoU >= 0.5 with the true box. False alarm: a box of "
        "which less than half lies on a person not found before. Keypoints: those that are seen, "
        "of people in full view, found with the confidence that the detector asks for (0.3 for "
        "MoveNet, 0.6 for others).",
        markdown(MODEL_HEADER, rows),
    )


COST_HEADER = [
    "scenario",
    "people",
    "geometry only",
    "depth and owners, 1 thread",
    "2 threads",
    "colour without smooth edges, 1 thread",
    "2 threads",
    "colour, 1 thread",
    "2 threads",
]
MODEL_HEADER = [
    "model",
    "found in full view",
    "found partly hidden",
    "false alarms a frame",
    "boxes with IoU below 0.5 a frame",
    "keypoint error p50 / p90 px",
    f"median px: {' / '.join(POINTS)}",
    "left and right swapped",
]


if __name__ == "__main__":
    main()
