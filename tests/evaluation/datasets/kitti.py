"""A miniature in the layout of KITTI tracking."""

from collections.abc import Iterable
from pathlib import Path

from tests.evaluation.datasets.people import DrawnBoxes, drawn_boxes, lab_people

# Class, truncation and occlusion of the people of `drawn_boxes`; the last one is distant
KINDS = [("Pedestrian", 0, 0)] * 4 + [("Person", 0, 0), ("Pedestrian", 1, 0)]
KINDS += [("Pedestrian", 0, 3), ("Cyclist", 0, 0), ("Pedestrian", 0, 1)]
REGION = (150, 60, 200, 220)  # left, top, width, height of the part of all images without labels
UNKNOWN = "-1 -1 -1 -1000 -1000 -1000 -10"
Kind = tuple[str, int, int]
Box = tuple[int, int, int, int]


def line(frame: int, one: int, kind: Kind, box: Box, score: str = "") -> str:
    left, top, width, height = box
    name, truncation, occlusion = kind
    corners = f"{left} {top} {left + width} {top + height}"
    return f"{frame} {one} {name} {truncation} {occlusion} -10 {corners} {UNKNOWN}{score}\n"


def write_split(
    folder: Path, split: str, frames: int, det: Iterable[str], labels: Iterable[str] | None
) -> None:
    """Write sequence 0000 of a split: a car that turns left by 0.01 rad a frame."""
    files = {"det_02": "".join(det), "label_02": None if labels is None else "".join(labels)}
    files["oxts"] = "".join(f"49 8 110 0 0 {0.01 * k} {'0 ' * 24}\n" for k in range(frames))
    for part, text in files.items():
        if text is not None:
            (folder / split / part).mkdir(parents=True, exist_ok=True)
            (folder / split / part / "0000.txt").write_text(text)


def write_kitti(folder: Path) -> Path:
    """Write a training sequence, and a test sequence without labels."""
    walking = ("Pedestrian", 0, 0)
    people = [(k, one) for k, visible in enumerate(lab_people()) for one in visible]
    det = [line(k, -1, ("Pedestrian", -1, -1), one.box_px, " 0.9") for k, one in people]
    labels = [line(k, one.id, walking, one.box_px) for k, one in people]
    write_split(folder, "training", len(lab_people()), det, labels)
    write_split(folder, "testing", len(lab_people()), det, None)
    return folder


def write_drawn(folder: Path) -> DrawnBoxes:
    """Write `drawn_boxes` with people of several classes and a region without labels."""
    drawn = drawn_boxes()
    labels = [line(k, -1, ("DontCare", -1, -1), REGION) for k in range(len(drawn.truth))]
    labels += [
        line(k, one, KINDS[one - 1], box)
        for k, people in enumerate(drawn.truth)
        for one, box in people
    ]
    write_split(folder, "training", len(drawn.truth), [], labels)
    return drawn
