"""Configuration of the area of a tracker."""

from typing import Annotated

from msgspec import Meta

from common.config import Config
from people4d.messages.areas import AREAS_MAX
from people4d.messages.base import Name

Memory = Annotated[float, Meta(gt=0, le=600)]


class SiteAreaConfig(Config, frozen=True, kw_only=True):
    """The area of a site that this tracker covers; its name is the name of the robot."""

    # Robot names of additional hosts with tracked cameras. Names of cameras and frames are unique
    # across hosts
    hosts: tuple[Name, ...] = ()
    # Number n of this area, unique in the site: its identities are n, n + 1000, n + 2000, ...
    # 0: no areas
    number: Annotated[int, Meta(ge=0, lt=AREAS_MAX)] = 0
    neighbours: tuple[Name, ...] = ()  # names of neighbouring areas
    # [s] maximum time since the last match for handing over an identity
    memory_s: Memory = 30.0
