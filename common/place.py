"""Which process this is."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Place:
    """Which process this is.

    Args:
        service: Name of the service.
        instance: Name of the process, unique on a robot.
        host: Name of the machine.
    """

    service: str
    instance: str
    host: str

    @property
    def process(self) -> str:
        """Name in traces."""
        return f"{self.instance}@{self.host}"
