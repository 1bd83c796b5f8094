"""Steps of real people, counted by eye, and their comparison with published steps."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import msgspec
import numpy as np

from services.gait.steps.steps import Side

NEAR_FRAMES = 1.2  # Maximum time between an annotated and a published step [frames]
OWNER_FRAMES = 5  # Number of frames about a step that assign it to a person
Landing = tuple[float, Side]  # time or frame, and foot


class StepByEye(msgspec.Struct, frozen=True):
    """Landing of a foot."""

    frame: float
    foot: Literal["left", "right"]
    hidden: bool = False  # True: the foot was not visible at the landing


class StepsByEye(msgspec.Struct, frozen=True):
    """Landings of one person, and the frames in which they can be counted."""

    person: str
    half: Literal["choose", "judge"]
    spans: tuple[tuple[float, float], ...]
    steps: tuple[StepByEye, ...]


class StepFile(msgspec.Struct, frozen=True):
    """File of annotated landings."""

    people: tuple[StepsByEye, ...]


@dataclass
class StepCounts:
    """Steps of one person, or of several."""

    true: int = 0
    hidden: int = 0  # number of true steps of an invisible foot
    published: int = 0  # number of steps in the frames with counted steps
    found: int = 0
    other_foot: int = 0  # number of found steps of the wrong foot
    invented: int = 0
    off_frames: list[float] = field(default_factory=list)
    lost: list[StepByEye] = field(default_factory=list)  # true steps without a published one

    def add(self, other: "StepCounts") -> None:
        """Add the steps of another person."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)

    def cells(self) -> list[str]:
        """Return the figures of a row."""
        off = f"{np.median(self.off_frames):.1f}" if self.off_frames else "-"
        numbers = (self.true, self.hidden, self.published)
        rest = (self.other_foot, self.invented)
        return [*map(str, numbers), f"{self.found} of {self.true}", *map(str, rest), off]


def by_person(
    landed: Mapping[int, Sequence[Landing]], owner: Mapping[tuple[int, int], str], rate_hz: float
) -> dict[str, list[Landing]]:
    """Return the landings of each track (time [s], foot) as frame and foot of each person."""
    found: dict[str, list[Landing]] = {}
    for track, landings in landed.items():
        for time_s, foot in landings:
            at = time_s * rate_hz
            near = range(int(at) - OWNER_FRAMES, int(at) + OWNER_FRAMES + 1)
            votes = Counter(owner[track, index] for index in near if (track, index) in owner)
            if votes:
                found.setdefault(votes.most_common(1)[0][0], []).append((at, foot))
    return found


def counts(known: StepsByEye, published: Sequence[Landing]) -> StepCounts:
    """Count the annotated steps that were published, each by the nearest step."""
    inside = [
        (at, foot)
        for at, foot in published
        if any(begin - NEAR_FRAMES <= at <= end + NEAR_FRAMES for begin, end in known.spans)
    ]
    pairs = sorted(
        (abs(at - true.frame), n, k)
        for n, (at, _) in enumerate(inside)
        for k, true in enumerate(known.steps)
        if abs(at - true.frame) <= NEAR_FRAMES
    )
    one, taken = StepCounts(true=len(known.steps)), dict[int, int]()
    for off, n, k in pairs:
        if n not in taken and k not in taken.values():
            taken[n] = k
            one.off_frames.append(off)
            one.other_foot += inside[n][1] != known.steps[k].foot
    one.hidden = sum(step.hidden for step in known.steps)
    one.found = len(taken)
    one.lost = [step for k, step in enumerate(known.steps) if k not in taken.values()]
    one.invented = sum(
        n not in taken and any(begin <= at <= end for begin, end in known.spans)
        for n, (at, _) in enumerate(inside)
    )
    one.published = one.found + one.invented
    return one
