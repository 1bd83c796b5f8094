"""Health of processes: diagnostic_msgs."""

from collections.abc import Iterable

from common.ros2.messages.basic import time
from common.ros2.types import Fields
from people4d.messages import Health

DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"

OK, WARN, ERROR, STALE = 0, 1, 2, 3  # diagnostic_msgs/DiagnosticStatus
LEVELS = {"ready": OK, "starting": WARN, "degraded": WARN, "stopping": WARN, "stalled": ERROR}


def diagnostics(healths: Iterable[tuple[Health, bool]], stamp_ns: int) -> Fields:
    """Return a DiagnosticArray from the last message of each process, stale if not recent."""
    status = [_status(health, recent) for health, recent in healths]
    return {"header": {"stamp": time(stamp_ns)}, "status": status}


def _status(health: Health, recent: bool) -> Fields:
    numbers = {**health.counters, **{name: round(x, 3) for name, x in health.gauges.items()}}
    return {
        "level": LEVELS[health.state] if recent else STALE,
        "name": f"people4d: {health.instance}",
        "message": (health.reason or health.state) if recent else "no message from this process",
        "hardware_id": health.host,
        "values": [{"key": name, "value": str(number)} for name, number in numbers.items()],
    }
