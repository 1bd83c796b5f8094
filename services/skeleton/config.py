"""Configuration of skeletons."""

from common.config import Config
from people4d.messages.base import PositiveInt


class SkeletonConfig(Config, frozen=True, kw_only=True):
    """Configuration of the service."""

    people_max: PositiveInt = 200  # maximum number of skeletons
