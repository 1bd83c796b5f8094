"""The camera of the attacked system: three people who stand, few frames a second."""

from benchmarks.lib.system.standing import Standing


class StandingPeople(Standing):
    """Shows people who stand, at a rate that a busy machine keeps up with."""

    rate_hz = 6.0
