"""Labels of rendered candidates, and the form of their images, for rendering and training."""

from enum import IntEnum

MARGIN_PX = 3  # [px] margin of stored images on each side of the network's input
# Side of a pixel at the candidate's depth [m], as in services/detector/position/body.py
PIXEL_M = 0.0344

PERSON_MIN = -2.5  # minimum log-odds of a person, as in services/tracker/motion/lifecycle.py


class Kind(IntEnum):
    """Content of a candidate; only the first is a person."""

    PERSON = 0
    FLAT_FIGURE = 1
    MANNEQUIN = 2
    ROBOT = 3
    FURNITURE = 4
    EMPTY = 5
    OTHER_LAYER = 6  # box of a person, at the depth of another surface

    @property
    def title(self) -> str:
        """Name in prints."""
        return self.name.lower().replace("_", " ")
