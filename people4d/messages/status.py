"""Messages about the system itself."""

from typing import Literal

import msgspec

from people4d.messages.base import Message, Name, Text

State = Literal["starting", "ready", "degraded", "stalled", "stopping"]


class Health(Message, frozen=True, kw_only=True):
    """Heartbeat of one process."""

    service: Name  # name of the service, for example "detector"
    instance: Name  # name of this process, for example "detector-1"
    host: Text  # name of the machine it runs on
    pid: int  # process number on that machine
    # degraded: works with limits, or waits for another service; stalled: its own work makes no
    # progress
    state: State
    reason: Text = ""  # reason of a state other than ready, one sentence; empty if ready
    release: Text = ""  # release of people4d, for example "0.1.0"; empty if unknown
    # number of events since the start, by name
    counters: dict[Text, int] = msgspec.field(default_factory=dict)
    # values of the last period, by name; the suffix is the unit: _hz, _ms, _percent, _mb
    gauges: dict[Text, float] = msgspec.field(default_factory=dict)
