"""Edits of zones by the page."""

import time
from typing import Annotated

import msgspec

from common.io.zones import PlainZone
from people4d.codec import decode, encode
from people4d.messages import ZoneEdit


class ZonesRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Request of a page to replace the zones."""

    base: Annotated[int, msgspec.Meta(ge=0, le=2**53)]  # sequence of the edited Zones
    zones: list[PlainZone]


def zone_edit(request: ZonesRequest) -> ZoneEdit:
    """Return the message of a request.

    ValueError if a zone is invalid, for example crosses itself; DecodeError if a zone is invalid by
    a check of the decoder.
    """
    zones = tuple(
        msgspec.structs.replace(zone, name=zone.name.strip()).zone() for zone in request.zones
    )
    edit = ZoneEdit(stamp_ns=time.time_ns(), sequence=0, base=request.base, zones=zones)
    checked = decode(encode(edit))
    assert isinstance(checked, ZoneEdit)
    return checked
