"""Which process this is."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Place:
    """Which process this is.

    Args:
        service: Name of the service.
        instance: Name of the process, unique on a robot.
        host: Name of the machine.
        capacity: Speed beside that of its replicas, 1 to 100: who has 2 gets twice as much to do.
    """

    service: str
    instance: str
    host: str
    capacity: int = 1

    @property
    def process(self) -> str:
        """Name in traces."""
        return f"{self.instance}@{self.host}"
