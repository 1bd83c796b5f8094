"""Configuration of the site."""

from common.config import Config
from people4d.messages.base import Name, Positive


class SiteConfig(Config, frozen=True, kw_only=True):
    """Areas of a site, and the merging of their people."""

    areas: tuple[Name, ...] = ()  # names of the areas: robot names of their trackers
    rate_hz: Positive = 15.0  # rate of the stream [Hz]
