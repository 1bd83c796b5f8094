"""Tracks and ground truth as rows of a table, for spreadsheets and data frames."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from people4d.messages import PersonSkeleton, Track, Tracks, Truth, TruthPerson

Cell: TypeAlias = str | int | float | None  # None: unknown, or not in this kind of row


@dataclass(frozen=True)
class Column:
    """Column of the table."""

    name: str  # name with the unit at its end
    kind: type[str | int | float]  # type of its cells
    meaning: str  # description of the content
    optional: bool = False  # True if cells may be empty


COLUMNS = (
    Column("kind", str, "`truth` or `track`"),
    Column("stamp_ns", int, "[ns] acquisition time; spreadsheets round it"),
    Column("time_s", float, "[s] since the stamp of the first row"),
    Column("frame_id", str, "frame of position, velocity and yaw"),
    Column("id", str, "identity: text in the truth, a number >= 1 of a track"),
    Column("x_m", float, "[m] position: torso"),
    Column("y_m", float, "[m]"),
    Column("z_m", float, "[m] up"),
    Column("vx_mps", float, "[m/s] velocity", optional=True),
    Column("vy_mps", float, "[m/s]", optional=True),
    Column("vz_mps", float, "[m/s]", optional=True),
    Column("yaw_rad", float, "[rad] direction of the chest, 0 = +x, (-pi, pi]", optional=True),
    Column("path_yaw_rad", float, "[rad] truth: direction of walking, (-pi, pi]", optional=True),
    Column("state", str, "track: `tentative`, `confirmed`, `lost` (only predicted)", optional=True),
    Column("unseen_s", float, "[s] track: since the last match", optional=True),
    Column("score", float, "track: confidence of the last detection, 0 to 1", optional=True),
    Column("hits", int, "track: matched frames", optional=True),
    Column("age", int, "track: frames since it began", optional=True),
    Column("camera", str, "track: camera whose frame it is of", optional=True),
    Column("posture", str, "track: posture, if skeletons are recorded", optional=True),
    Column("posture_probability", float, "track: its probability, 0: unknown", optional=True),
    Column("stature_m", float, "[m] track: height of the body, by its bones", optional=True),
    Column("stature_sigma_m", float, "[m] track: its standard deviation", optional=True),
    Column("child", float, "track: probability of a stature below 1.45 m", optional=True),
    Column("object_like", float, "track: probability of an object, no person", optional=True),
)
NAMES = tuple(column.name for column in COLUMNS)


def rows_of(
    message: Truth | Tracks, start_ns: int, skeletons: Mapping[int, PersonSkeleton]
) -> Iterator[dict[str, Cell]]:
    """Yield one row for each person of a message, all columns in order.

    Args:
        message: Truth or tracks.
        start_ns: Stamp of the first row.
        skeletons: Skeletons of the frame of tracks, by identity.
    """
    head: dict[str, Cell] = {
        "kind": "truth" if isinstance(message, Truth) else "track",
        "stamp_ns": message.stamp_ns,
        "time_s": (message.stamp_ns - start_ns) / 1e9,
        "frame_id": message.frame_id,
        "camera": message.camera if isinstance(message, Tracks) else None,
    }
    for person in message.tracks if isinstance(message, Tracks) else message.people:
        row = head | _cells(person)
        if isinstance(person, Track) and person.id in skeletons:
            skeleton = skeletons[person.id]
            row |= {
                "posture": skeleton.posture,
                "posture_probability": skeleton.posture_probability,
                "stature_m": skeleton.stature_m,
                "stature_sigma_m": skeleton.stature_sigma_m,
                "child": skeleton.child,
                "object_like": skeleton.object_like,
            }
        yield {name: row.get(name) for name in NAMES}


def _cells(person: TruthPerson | Track) -> dict[str, Cell]:
    cells: dict[str, Cell] = {"id": str(person.id), "yaw_rad": person.yaw_rad}
    cells |= zip(("x_m", "y_m", "z_m"), map(float, person.position_m), strict=True)
    if person.velocity_mps is not None:
        cells |= zip(("vx_mps", "vy_mps", "vz_mps"), map(float, person.velocity_mps), strict=True)
    if isinstance(person, TruthPerson):
        return cells | {"path_yaw_rad": person.path_yaw_rad}
    return cells | {
        "state": person.state,
        "unseen_s": person.time_since_update_s,
        "score": person.score,
        "hits": person.hits,
        "age": person.age,
    }
