"""The plan of a chaos soak: what is done to a system, and when, from nothing but a seed."""

import random
from dataclasses import dataclass

CALM_S = 20.0  # at the beginning and at the end, undisturbed
GAP_S = (6.0, 18.0)  # from one disturbance to the next; some overlap
SERVICES = ("camera", "detector", "reid", "tracker", "router", "watchdog")

# Kinds of disturbance: targets, and the range of durations [s]; 0 if it is over at once.
KINDS: dict[str, tuple[tuple[str, ...], tuple[float, float]]] = {
    "kill": (SERVICES, (0.0, 0.0)),
    "stop": (SERVICES, (0.3, 12.0)),
    "clock step": (("+0.3", "+10", "+3600", "-0.3", "-0.8", "-10"), (0.0, 0.0)),
    "overload": (("2", "4", "8"), (3.0, 15.0)),
    "stuck reader": (("**",), (3.0, 20.0)),
    "network cut": (("silence", "reset"), (2.0, 15.0)),
    "flood": (("garbage", "heartbeats", "embeddings"), (3.0, 12.0)),
}


@dataclass(frozen=True)
class Disturbance:
    """One thing that is done to the system.

    Args:
        at_s: When, after the beginning.
        kind: One of KINDS.
        target: Service, seconds of a clock step, processes that use the processor without end,
            way of a cut, content of a flood.
        duration_s: How long.
    """

    at_s: float
    kind: str
    target: str
    duration_s: float

    def __str__(self) -> str:
        """Return it as one line."""
        during = f" for {self.duration_s:.1f} s" if self.duration_s else ""
        return f"{self.at_s:7.1f} s  {self.kind} {self.target}{during}"


def plan(seed: int, minutes: float) -> list[Disturbance]:
    """Return all disturbances in order; the same for the same seed and time."""
    chance = random.Random(seed)
    planned: list[Disturbance] = []
    at_s = CALM_S
    while True:
        kind = chance.choice(list(KINDS))
        targets, (least_s, most_s) = KINDS[kind]
        target = chance.choice(targets)
        duration_s = round(chance.uniform(least_s, most_s), 1)
        if at_s + duration_s > minutes * 60 - CALM_S:
            return planned
        planned.append(Disturbance(round(at_s, 1), kind, target, duration_s))
        at_s += chance.uniform(*GAP_S)
