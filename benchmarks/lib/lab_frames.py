"""Images of the virtual lab with their truth, for benchmarks."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from evaluation.recordings.rendered import has_to_be_found
from lab.camera.frames import FrameRenderer, RenderSettings
from lab.catalogue import load_scenario
from lab.drawing.renderer import DepthView
from lab.truth.frames import PersonView, person_views
from lab.world import World
from people4d.messages import U8

ALONE_MIN = 0.9  # visible share from which nothing hides a person


@dataclass(frozen=True)
class LabFrame:
    """One frame and all that is true in it."""

    scenario: str
    time_s: float
    rgb: U8
    view: DepthView
    people: Sequence[PersonView]
    bodies: Sequence[str]  # name in the cast of each of people


def lab_frames(name: str, count: int, seed: int | None = None) -> Iterator[LabFrame]:
    """Draw frames of a scenario, spread evenly over its time."""
    world = World(load_scenario(name, seed), seed)
    renderer = FrameRenderer(world, RenderSettings())
    bodies = [person.body for person in world.scenario.people]
    for index in np.linspace(0, world.frame_count - 1, count).astype(int).tolist():
        view = renderer.view(index)
        people = person_views(world, world.frame_s(index), view)
        yield LabFrame(name, world.frame_s(index), renderer.rgb(index, view), view, people, bodies)


def is_alone(person: PersonView, size: tuple[int, int]) -> bool:
    """Check that nothing hides a person that has to be found."""
    return has_to_be_found(person, size) and person.visible_share >= ALONE_MIN
