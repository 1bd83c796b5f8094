"""Configuration of the events."""

from common.config import Config
from people4d.messages.base import Name, NonNegative, Positive, PositiveInt, Probability


class EventsConfig(Config, frozen=True, kw_only=True):
    """Zones and thresholds."""

    zones_file: str = ""  # JSON file of the zones; empty: zones.json in the state folder
    absent_s: Positive = 1.0  # [s] time without a track after which a person has disappeared
    margin_m: NonNegative = 0.15  # [m] distance outside a zone at which a person has left it
    near_m: NonNegative = 1.0  # [m] maximum distance to the robot of a near person; 0: no event
    near_margin_m: NonNegative = 0.3  # [m] additional distance at which a person is no longer near
    faces_s: Positive = 3.0  # [s] duration of facing the robot that is an event
    lies_s: Positive = 10.0  # [s] duration of lying that is an event; with skeletons
    # confidences of an identity below which it is uncertain, and above which it is certain again
    uncertain_below: Probability = 0.5
    certain_above: Probability = 0.7  # see uncertain_below
    # maximum number of events in the journal; the oldest are deleted
    journal_max: PositiveInt = 100_000
    webhook: str = ""  # http or https address for every event as JSON; empty: none
    # mqtt://[user@]host[:port][/topic], or mqtts: broker for every event; empty: none
    mqtt: str = ""
    base_frame: Name = "base_link"  # the robot's base
