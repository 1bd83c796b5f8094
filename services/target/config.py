"""Configuration of the chosen person."""

from typing import Annotated

from msgspec import Meta

from common.config import Config
from people4d.messages.base import Name, Positive


class TargetConfig(Config, frozen=True, kw_only=True):
    """Thresholds of the chosen person."""

    # minimum probability that a locked track is the chosen person
    probability_min: Annotated[float, Meta(ge=0.5, le=0.99)] = 0.95
    lost_after_s: Positive = 5.0  # [s] search after which the person is lost; the search goes on
    speed_max_mps: Positive = 2.5  # [m/s] maximum speed of the person while out of sight
    # [days] time after which an enrolled person is deleted; 0: enrolment is off
    enrolment_days: Annotated[float, Meta(ge=0.0, le=366.0)] = 0.0
    base_frame: Name = "base_link"  # the robot's base, origin of distance and bearing
