"""Zones as plain values, for files and pages."""

import msgspec
import numpy as np

from people4d.messages import Zone


class PlainZone(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A zone as plain values."""

    name: str
    corners_m: list[tuple[float, float]]  # [m] x, y of the corners
    dwell_s: float | None = None  # [s] duration of a stay that is an event; None: no such event
    count: int | None = None

    @classmethod
    def from_zone(cls, zone: Zone) -> "PlainZone":
        """Return the values of a zone."""
        corners_m = [(float(x), float(y)) for x, y in zone.corners_m]
        return cls(zone.name, corners_m, zone.dwell_s, zone.count)

    def zone(self) -> Zone:
        """Return the zone; ValueError if the polygon is invalid, for example crosses itself."""
        return Zone(
            name=self.name,
            corners_m=np.array(self.corners_m, float).reshape(-1, 2),
            dwell_s=self.dwell_s,
            count=self.count,
        )
