"""What the eye sees in recordings of real people, and how detections and tracks compare with it.

All pixels (u, v) were picked by hand in the colour images.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from people4d.messages import Detection, Detections, Tracks
from services.tracker.sort3d.association import assign

Pixel = tuple[int, int]

# Frames of filinha (the first is 0) with everyone who is seen in them, by a name for each person.
# In frame 52 "white" shows only the top of his head, in 68 and 76 "striped" is half hidden.
CROSSING: dict[int, dict[str, Pixel]] = {
    44: {"navy": (105, 160), "jeans": (245, 136), "grey": (160, 395)},
    52: {"navy": (46, 309), "jeans": (128, 111), "grey": (293, 222), "white": (256, 371)},
    60: {"jeans": (130, 187), "grey": (210, 125), "white": (272, 217), "striped": (324, 322)},
    68: {"grey": (107, 125), "white": (221, 131), "striped": (272, 150), "purple": (318, 267)},
    76: {"grey": (167, 225), "white": (120, 114), "striped": (222, 95), "purple": (284, 169)},
    84: {"white": (132, 213), "striped": (110, 80), "purple": (219, 95)},
}

# Chest, middle and belly of the man in front in the TUE bags (one frame each), with the depth in
# millimetres that the depth image has there.
TORSO_MM: dict[str, dict[Pixel, int]] = {
    "2019-05-03-12-41-38": {(300, 150): 2040, (310, 190): 1947, (320, 230): 1947},
    "2019-05-03-12-42-18": {(340, 150): 1785, (340, 200): 1722, (330, 270): 1705},
    "2019-05-03-12-42-25": {(340, 150): 1785, (340, 200): 1722, (330, 270): 1705},
    "2019-05-03-12-42-30": {(355, 180): 1722, (355, 230): 1696, (350, 270): 1688},
    "2019-05-03-12-42-34": {(340, 160): 1757, (345, 220): 1705, (340, 270): 1696},
}


@dataclass(frozen=True)
class Seen:
    """Detections and tracks in the frames of CROSSING.

    Args:
        people: Seen by eye, over all frames.
        found: Of them detected.
        false: Boxes that hold nobody, or one who has a box already.
        identified: Of the people seen, those tracked under the identity that is theirs when people
            and identities are paired one to one, as well as can be.
    """

    people: int
    found: int
    false: int
    identified: int


def compare(detections: Sequence[Detections], tracks: Sequence[Tracks]) -> Seen:
    """Compare a whole run, a message of each kind a frame, with what the eye sees."""
    boxes = found = 0
    together: dict[tuple[str, int], int] = {}  # frames that a person had an identity
    for frame, people in CROSSING.items():
        pairs = match(list(people.values()), detections[frame].detections)
        owners = {t.detection: t.id for t in tracks[frame].tracks}
        boxes, found = boxes + len(detections[frame].detections), found + len(pairs)
        for i, j in pairs:
            if j in owners:
                pair = list(people)[i], owners[j]
                together[pair] = together.get(pair, 0) + 1
    return Seen(
        people=sum(map(len, CROSSING.values())),
        found=found,
        false=boxes - found,
        identified=_best_sum(together),
    )


def match(points: Sequence[Pixel], detections: Sequence[Detection]) -> list[tuple[int, int]]:
    """Return the pairs (point, detection) where a box holds a point, each at most once."""
    cost = np.full((len(points), len(detections)), np.inf)
    for i, (u, v) in enumerate(points):
        for j, detection in enumerate(detections):
            left, top, right, bottom = map(float, detection.box_xyxy_px)
            if left <= u <= right and top <= v <= bottom:
                cost[i, j] = abs(2 * u - left - right) + abs(2 * v - top - bottom)
    return assign(cost)


def _best_sum(together: dict[tuple[str, int], int]) -> int:
    """Return the largest sum of counts when names and identities are paired one to one."""
    names = sorted({name for name, _ in together})
    identities = sorted({identity for _, identity in together})
    counts = np.zeros((len(names), len(identities)))
    for (name, identity), count in together.items():
        counts[names.index(name), identities.index(identity)] = count
    return int(sum(counts[i, j] for i, j in assign(-counts)))
