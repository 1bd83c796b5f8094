"""File of zones."""

from pathlib import Path

import msgspec

from common.io.files import read_bytes, write_private
from common.io.zones import PlainZone
from people4d.errors import ConfigError
from people4d.messages import Zone
from people4d.messages.events import ZONES_MAX

FILE_MAX = 2**20  # maximum size of the file [bytes]


class StoredZones(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Content of the file of zones."""

    revision: int
    zones: list[PlainZone]


def read_zones(file: Path) -> tuple[int, tuple[Zone, ...]]:
    """Return revision and zones of a file; 0 and no zones without a file.

    Raises:
        ConfigError: The file is not valid.
    """
    try:
        stored = msgspec.json.decode(read_bytes(file, FILE_MAX), type=StoredZones)
        zones = tuple(zone.zone() for zone in stored.zones[: ZONES_MAX + 1])
        if len(zones) > ZONES_MAX or len({zone.name for zone in zones}) < len(zones):
            raise ValueError(f"expected {ZONES_MAX} zones at most, each name once")
    except FileNotFoundError:
        return 0, ()
    except (OSError, msgspec.DecodeError, ValueError) as error:
        hint = "Correct the file, or move it away."
        raise ConfigError(f"zones in {file} are not valid: {error}", hint) from error
    return stored.revision, zones


def write_zones(file: Path, revision: int, zones: tuple[Zone, ...]) -> None:
    """Replace the file; OSError if that fails."""
    stored = StoredZones(revision, [PlainZone.from_zone(zone) for zone in zones])
    write_private(file, msgspec.json.format(msgspec.json.encode(stored), indent=2) + b"\n")
