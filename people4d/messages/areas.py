"""People of one area for the trackers of its neighbours."""

from typing import Annotated

import numpy as np
from msgspec import Meta

from people4d.messages.base import (
    F32,
    Message,
    Name,
    PositiveInt,
    Record,
    Text,
    Vector3,
)
from people4d.validation import Magnitude, Shape

AREAS_MAX = 1000  # upper limit of area numbers, exclusive
ID_MAX = 10**12
PEOPLE_MAX = 256  # maximum number of people in a message
UNIT_ERROR = 0.01  # maximum difference of the length of a view from 1


class AreaPerson(Record, frozen=True, kw_only=True):
    """One person known to a tracker, present or absent."""

    id: Annotated[int, Meta(ge=1, le=ID_MAX)]  # identity, unique over the site
    position_m: Vector3  # [m] frame: AreaPeople.frame_id, at the last match
    unmatched_s: Annotated[float, Meta(ge=0, le=3600)]  # [s] time since the last match
    matches: PositiveInt  # number of frames in which this tracker matched the person
    # embeddings of unit length, chosen to differ; cosine distance is 1 - a.b
    views: Annotated[F32, Shape("V", "D"), Magnitude(1.1)]

    def __post_init__(self) -> None:
        """Check the fields, and the length of the views."""
        super().__post_init__()
        lengths = np.linalg.norm(self.views, axis=1)
        if np.any(np.abs(lengths - 1) > UNIT_ERROR):
            raise ValueError("views: expected unit length, got others")


class AreaPeople(Message, frozen=True, kw_only=True):
    """People known to the tracker of one area, sent several times a second.

    The tracker of a neighbouring area takes over the identity of an arriving person. `stamp_ns`
    is the time of the tracker when the message is sent.
    """

    area: Name  # name of the area: its robot name
    number: Annotated[int, Meta(ge=1, lt=AREAS_MAX)]  # number of the area, unique in the site
    # random number of the tracker's process, distinguishes trackers of one name
    run: Annotated[int, Meta(ge=0, lt=2**53)]
    frame_id: Name  # frame of the positions
    embedder: Text  # name of the model of the views
    # present and absent people with views, the most recent ones if there are more
    people: Annotated[tuple[AreaPerson, ...], Meta(max_length=PEOPLE_MAX)] = ()
