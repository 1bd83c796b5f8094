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
    # ready: it does its work; degraded: with limits, or it would if something came from elsewhere;
    # stalled: it does not go on itself; starting and stopping: not yet, and no more
    state: State
    reason: Text = ""  # why it is not ready, one sentence; empty when ready
    release: Text = ""  # people4d release that runs there, for example "0.1.0"; empty: not told
    counters: dict[Text, int] = msgspec.field(default_factory=dict)  # events since start, by name
    # of the last period, by name; its end tells the unit: _hz, _ms, _percent, _mb
    gauges: dict[Text, float] = msgspec.field(default_factory=dict)
