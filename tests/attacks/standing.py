"""The camera of the attacked system: three standing people, few frames a second."""

from benchmarks.lib.system.standing import Standing


class StandingPeople(Standing):
    """Shows standing people, at a rate possible on a busy machine."""

    rate_hz = 6.0
