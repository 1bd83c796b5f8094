"""Choice of a frame's input size."""

import numpy as np

from services.detector.config import DetectorConfig, NearInputConfig
from services.detector.input_size import InputSizeChoice
from services.detector.models.base import DetectedPerson
from services.detector.node import DetectorNode
from tests.detector.cameras import INFO
from tests.detector.test_node import FixedModel, frame, person

CONFIG = NearInputConfig(height=160, width=224)
SIZE = (480, 640)  # a third of it is the smaller input: 100 px there are 300 px here


def of_height(height_px: float, left_px: float = 0.0) -> DetectedPerson:
    return DetectedPerson(0.9, np.array([left_px, 10, left_px + 50, 10 + height_px], np.float32))


def played(*views: list[DetectedPerson]) -> str:
    """Return the sizes of a camera's frames that show these people: full or near."""
    choice, sizes = InputSizeChoice(CONFIG), ""
    for people in views:
        near = choice.is_near("front")
        choice.add_frame("front", near, people, SIZE)
        sizes += "n" if near else "F"
    return sizes


def test_of_near_people_every_fourth_frame_is_full() -> None:
    assert played(*[[of_height(310), of_height(400, 100)]] * 9) == "FnnnFnnnF"


def test_frames_are_full_while_somebody_is_far() -> None:
    assert played(*[[of_height(400), of_height(240, 100)]] * 4) == "FFFF"


def test_frames_are_full_while_people_overlap() -> None:
    assert played(*[[of_height(400), of_height(400, 40)]] * 4) == "FFFF"


def test_frames_are_full_while_no_one_is_in_view() -> None:
    assert played(*[list[DetectedPerson]()] * 4) == "FFFF"


def test_the_frame_after_someone_came_or_went_is_full() -> None:
    one, two = [of_height(310)], [of_height(310), of_height(310, 100)]
    assert played(one, one, two, two, two) == "FnnFn"
    assert played(two, two, one, one, one) == "FnnFn"


def test_cameras_are_apart() -> None:
    choice = InputSizeChoice(CONFIG)
    choice.add_frame("front", False, [of_height(310)], SIZE)
    assert choice.is_near("front")
    assert not choice.is_near("back")


def node_of_two() -> tuple[DetectorNode, FixedModel, FixedModel]:
    """Return a calibrated detector, its model and that with the smaller input."""
    config = DetectorConfig(near_input=NearInputConfig(height=160, width=224))
    full, near = FixedModel([person()]), FixedModel([person()])
    made = DetectorNode(full, config, near)
    made.handle(INFO, 0)
    return made, full, near


def test_the_node_gives_the_smaller_input_and_counts_it() -> None:
    made, full, near = node_of_two()
    for number in range(8):
        made.handle(frame(number), 0)
    assert (len(full.images), len(near.images)) == (2, 6)
    assert made.status().counters["near_inputs"] == 6


def test_after_a_frame_that_failed_the_size_is_chosen_by_the_one_before() -> None:
    made, full, near = node_of_two()
    for number in range(6):
        made.handle(frame(number, white=number == 1), 0)
    assert made.status().counters["model_errors"] == 1
    assert (len(full.images), len(near.images)) == (2, 4)
