"""What points look like in all pictures."""

from collections.abc import Mapping
from types import MappingProxyType

from common.drawing.palette import PEOPLE, Colour
from services.gait.points.points import HEAD, LEFT_FOOT, LEFT_HAND, RIGHT_FOOT, RIGHT_HAND

COLOURS: Mapping[str, Colour] = MappingProxyType(
    {
        HEAD: (240, 190, 20),
        LEFT_HAND: (38, 132, 255),
        RIGHT_HAND: (232, 70, 70),
        LEFT_FOOT: (20, 184, 200),
        RIGHT_FOOT: (222, 64, 160),
    }
)


def colour_of_point(name: str) -> Colour:
    """Return the colour of a point by its name."""
    return COLOURS.get(name, PEOPLE[sum(name.encode()) % len(PEOPLE)])
