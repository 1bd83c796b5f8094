"""Which of several equal processes does which message: all of them find the same, unasked.

Weighted round-robin over the sorted names, not rendezvous hashing. Hashing moves few messages when
the team changes, which is worth nothing here: no replica keeps anything about a camera. But it
throws a coin for each frame: of two replicas one gets two frames in a row half of the time, and
drops the first of them or makes it wait. In turns, consecutive frames go to different replicas, and
each gets its frames at even distances.
"""

import zlib
from collections.abc import Mapping
from functools import reduce
from math import gcd

CAPACITY_MAX = 100


def turns(capacities: Mapping[str, int]) -> tuple[str, ...]:
    """Return who has which turn, one round long, as evenly mixed as the capacities allow.

    The smooth weighted round-robin: everyone gains their capacity at each turn; whoever has most
    takes the turn and pays a whole round for it. 2 and 1 give a b a, never a a b.

    Args:
        capacities: Relative speed of each member, 1 to CAPACITY_MAX, by name.
    """
    divisor = reduce(gcd, capacities.values(), 0)
    gains = {name: capacities[name] // divisor for name in sorted(capacities)}
    round_length = sum(gains.values())
    credit, order = dict.fromkeys(gains, 0), []
    for _ in range(round_length):
        for name, gain in gains.items():
            credit[name] += gain
        taker = max(credit, key=lambda name: credit[name])  # the first of equals
        credit[taker] -= round_length
        order.append(taker)
    return tuple(order)


def owner(order: tuple[str, ...], camera: str, sequence: int) -> str | None:
    """Return who does the message of a camera with this number; None if nobody is there.

    Args:
        order: What `turns` gave.
        camera: Name of the camera. Each has its own beginning, so that of several cameras that
            run in step not all frames of one moment go to one member.
        sequence: Number of the message.
    """
    if not order:
        return None
    return order[(sequence + zlib.crc32(camera.encode())) % len(order)]
