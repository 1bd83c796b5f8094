"""Configuration of the events."""

from common.config import Config
from people4d.messages.base import Name, NonNegative, Positive, PositiveInt, Probability


class EventsConfig(Config, frozen=True, kw_only=True):
    """Zones and thresholds."""

    zones_file: str = ""  # JSON file of the zones; empty: zones.json in the state folder
    absent_s: Positive = 1.0  # [s] of stamps without a person after which they have disappeared
    margin_m: NonNegative = 0.15  # [m] outside of a zone, from which on a person has left it
    near_m: NonNegative = 1.0  # [m] distance to the robot below which is an event; 0: none is
    near_margin_m: NonNegative = 0.3  # [m] beyond it, from which on a person is no longer near
    # confidence of an identity below which is an event, and above which it is certain again
    uncertain_below: Probability = 0.5
    certain_above: Probability = 0.7
    journal_max: PositiveInt = 100_000  # events in the journal; the oldest make room
    webhook: str = ""  # http or https address that every event is posted to as JSON; empty: none
    # mqtt://[user@]host[:port][/topic], or mqtts: every event is published there; empty: nowhere
    mqtt: str = ""
    base_frame: Name = "base_link"  # the robot's base
    clock_jump_s: Positive = 1.0  # [s] a stamp older than the newest by more: everything is new
