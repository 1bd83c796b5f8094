"""Configuration of the site."""

from common.config import Config
from people4d.messages.base import Name, Positive


class SiteConfig(Config, frozen=True, kw_only=True):
    """The areas of a site, and how their people become one stream."""

    areas: tuple[Name, ...] = ()  # names of the areas: robot names of their trackers
    rate_hz: Positive = 15.0  # [Hz] of the stream
    # [s] without a message of a camera after which its people are left out; trackers predict people
    # meanwhile, ten times a second
    fresh_s: Positive = 0.5
    silence_s: Positive = 3.0  # [s] without people of an area after which it is reported
    # [m] on the ground between people of two areas who are one person, seen by both
    same_m: Positive = 0.5
    clock_tolerance_s: Positive = 1.0  # [s] difference of an area's clock that is reported
