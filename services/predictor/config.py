"""Configuration of the predictor."""

from typing import Annotated

from msgspec import Meta

from common.config import Config
from people4d.messages.base import Name, PositiveInt
from people4d.messages.prediction import HORIZONS_MAX


class PredictorConfig(Config, frozen=True, kw_only=True):
    """Configuration of the predictor."""

    # [Hz] maximum rate of predictions, by the stamps; tracks in between are not used
    rate_max_hz: Annotated[float, Meta(ge=2.5, le=1000)] = 10.0
    step_s: Annotated[float, Meta(ge=0.1, le=5)] = 0.5  # [s] interval between two horizons
    steps: Annotated[int, Meta(ge=1, le=HORIZONS_MAX)] = 10  # number of horizons
    people_max: PositiveInt = 500  # maximum number of predicted people
    base_frame: Name = "base_link"  # the robot's base
