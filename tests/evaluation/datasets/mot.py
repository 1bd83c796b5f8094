"""A miniature in the layout of MOT15, MOT17, MOT20 and DanceTrack."""

from collections.abc import Iterable
from pathlib import Path

from tests.evaluation.datasets.people import SIZE_PX, drawn_boxes, lab_people

INFO = (
    "[Sequence]\nname={name}\nimDir=img1\nframeRate=10\nseqLength={frames}\n"
    f"imWidth={SIZE_PX[0]}\nimHeight={SIZE_PX[1]}\nimExt=.jpg\n"
)
Line = tuple[object, ...]
# Class and flag of the people of `drawn_boxes`: pedestrians, a static person, an unflagged
# pedestrian, a person on a vehicle, a vehicle that is neutral in MOT20, and a car
CLASSES = [(1, 1), (1, 1), (1, 1), (1, 1), (7, 0), (1, 0), (2, 0), (6, 0), (3, 0)]


def write_sequence(folder: Path, frames: int, det: Iterable[Line], gt: Iterable[Line]) -> Path:
    """Write one sequence."""
    for part, lines in (("det", det), ("gt", gt)):
        (folder / part).mkdir(parents=True, exist_ok=True)
        text = "".join(f"{','.join(map(str, line))}\n" for line in lines)
        (folder / part / f"{part}.txt").write_text(text)
    (folder / "seqinfo.ini").write_text(INFO.format(name=folder.name, frames=frames))
    return folder


def write_mot(folder: Path, name: str = "MOT17-02-FRCNN", test: str = "MOT17-01-FRCNN") -> Path:
    """Write a training sequence, and a test sequence without truth."""
    people = list(enumerate(lab_people(), 1))
    det = [(n, -1, *p.box_px, 0.95) for n, visible in people for p in visible]
    gt = [(n, p.id, *p.box_px, 1, 1, round(p.visible, 3)) for n, visible in people for p in visible]
    write_sequence(folder / "train" / name, len(people), det, gt)
    write_sequence(folder / "test" / test, len(people), det, [])
    (folder / "test" / test / "gt" / "gt.txt").unlink()
    return folder


def write_drawn(folder: Path) -> Path:
    """Write `drawn_boxes` with people and things of several classes."""
    truth = drawn_boxes().truth
    gt = [
        (number, one, *box, CLASSES[one - 1][1], CLASSES[one - 1][0], 1)
        for number, people in enumerate(truth, 1)
        for one, box in people
    ]
    return write_sequence(folder / "train" / "drawn", len(truth), [], gt)
