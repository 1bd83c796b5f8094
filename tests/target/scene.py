"""Frames of people with known positions and appearance for the node of the chosen person."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from people4d.messages import Target, TargetCommand
from services.target.config import TargetConfig
from services.target.node import TargetNode
from tests import builders

FRAME_NS = 100_000_000
RED, BLUE, GREEN = 0.0, 90.0, 180.0  # appearance: angles [deg]; two differ by 1 - cos
Person = tuple[float, float, float]  # x, y [m], appearance [deg]


class Scene:
    """A node, and the frames that it gets.

    Args:
        node: Node under test.
        stamp_ns: Stamp of the first frame.
    """

    def __init__(self, node: TargetNode | None = None, stamp_ns: int = 0) -> None:
        self.node = node or TargetNode(TargetConfig())
        self.stamp_ns = stamp_ns
        self._ages: dict[int, int] = {}

    def choose(self, action: str = "id", **fields: Any) -> None:
        """Send a choice."""
        command: Any = {"stamp_ns": 0, "sequence": 0, "action": action, **fields}
        self.node.handle(TargetCommand(**command), 0)

    def frame(
        self,
        people: Mapping[int, Person],
        hidden: Sequence[int] = (),
        with_embeddings: bool = True,
        crops: int | None = None,
        cut: Sequence[int] = (),
        heights: Mapping[int, float] | None = None,
        **fields: Any,
    ) -> Target:
        """Return the answer to one frame.

        Args:
            people: People by track; each is in a box of its own.
            hidden: Tracks without a detection in this frame.
            with_embeddings: The appearance of the people arrives, too.
            crops: Number of crops, as Detections say.
            cut: Tracks at a side of the image.
            heights: Heights of the torso by track [m], usually 1.
            fields: Fields of Tracks.
        """
        self.stamp_ns += FRAME_NS
        visible = [track for track in people if track not in hidden]
        lefts = [0 if track in cut else 20 + 100 * k for k, track in enumerate(visible)]
        boxes = [[left, 50, left + 60, 300] for left in lefts]
        found = builders.detections(
            *(builders.detection(box_xyxy_px=np.array(box, np.float32)) for box in boxes),
            stamp_ns=self.stamp_ns,
            crops=crops,
        )
        angles = [math.radians(people[track][2]) for track in visible]
        vectors = [(math.cos(angle), math.sin(angle)) for angle in angles]
        self._ages = {track: self._ages.get(track, 0) + 1 for track in people}
        tracks = [
            builders.track(
                id=track,
                position_m=np.array([x, y, (heights or {}).get(track, 1.0)]),
                detection=None if track in hidden else visible.index(track),
                state="lost" if track in hidden else "confirmed",
                age=self._ages[track],
            )
            for track, (x, y, _) in people.items()
        ]
        self.node.handle(found, 0)
        if with_embeddings:
            self.node.handle(builders.embeddings(found, vectors), 0)
        (target,) = self.node.handle(builders.tracks(*tracks, stamp_ns=self.stamp_ns, **fields), 0)
        assert isinstance(target, Target)
        return target

    def frames(self, count: int, people: Mapping[int, Person], **fields: Any) -> Target:
        """Return the answer to the last of a number of equal frames."""
        for _ in range(count - 1):
            self.frame(people, **fields)
        return self.frame(people, **fields)


def followed(appearance: float = RED, **others: Person) -> Scene:
    """Return a scene with person 1 locked at (3, 0), and other people next to it."""
    scene = Scene()
    people = {1: (3.0, 0.0, appearance)} | {int(name[1:]): at for name, at in others.items()}
    scene.frame(people)
    scene.choose(id=1)
    assert scene.frames(10, people).state == "locked"
    return scene
