"""Configuration of the site."""

from common.config import Config
from people4d.messages.base import Name, Positive


class SiteConfig(Config, frozen=True, kw_only=True):
    """Areas of a site, and the merging of their people."""

    areas: tuple[Name, ...] = ()  # names of the areas: robot names of their trackers
    rate_hz: Positive = 15.0  # rate of the stream [Hz]
    # maximum silence of a camera whose people are published [s]; trackers predict people at 10 Hz
    # without frames
    fresh_s: Positive = 0.5
    silence_s: Positive = 3.0  # maximum silence of an area before it is reported [s]
    # maximum distance on the ground between two tracks of one person in two areas [m]
    same_m: Positive = 0.5
    clock_tolerance_s: Positive = 1.0  # maximum difference between the clocks of areas [s]
