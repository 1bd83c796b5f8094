"""Messages about the system itself."""

from typing import Literal

import msgspec

from people4d.messages.base import Message, check_finite, check_name, check_text

State = Literal["starting", "ready", "degraded", "stalled", "stopping"]


class Health(Message, frozen=True, kw_only=True):
    """Heartbeat of one process."""

    service: str  # name of the service, for example "detector"
    instance: str  # name of this process, for example "detector-1"
    host: str  # name of the machine it runs on
    pid: int  # process number on that machine
    # ready: it does its work; degraded: with limits, or it would if something came from elsewhere;
    # stalled: it does not go on itself; starting and stopping: not yet, and no more
    state: State
    reason: str = ""  # why it is not ready, one sentence; empty when ready
    release: str = ""  # people4d release that runs there, for example "0.1.0"; empty: not told
    counters: dict[str, int] = msgspec.field(default_factory=dict)  # events since start, by name
    # of the last period, by name; its end tells the unit: _hz, _ms, _percent, _mb
    gauges: dict[str, float] = msgspec.field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check names and numbers."""
        super().__post_init__()
        check_name("service", self.service)
        check_name("instance", self.instance)
        check_text("host, reason, release", self.host, self.reason, self.release)
        check_text("counters, gauges", *self.counters, *self.gauges)
        check_finite("gauges", *self.gauges.values())
