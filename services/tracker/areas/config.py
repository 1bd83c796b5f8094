"""Configuration of the area of a tracker."""

from typing import Annotated

from msgspec import Meta

from common.config import Config
from people4d.messages.areas import AREAS_MAX
from people4d.messages.base import Name

Memory = Annotated[float, Meta(gt=0, le=600)]


class SiteAreaConfig(Config, frozen=True, kw_only=True):
    """The area of a site that this tracker covers; the robot's name is its name."""

    # robot names of further hosts with tracked cameras; names of cameras and frames are unique over
    # all hosts
    hosts: tuple[Name, ...] = ()
    # of this area, unique in the site: it gives the identities n, n + 1000, n + 2000, ...; 0: there
    # are no areas
    number: Annotated[int, Meta(ge=0, lt=AREAS_MAX)] = 0
    neighbours: tuple[Name, ...] = ()  # names of the areas from which people come
    # [s] since their last match anywhere, for which people keep their identity from area to area
    memory_s: Memory = 30.0
