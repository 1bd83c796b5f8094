"""Options of random scenes, such as `lab:random?seed=7&density=0.2`."""

from typing import Annotated, Literal
from urllib.parse import parse_qsl

import msgspec
from msgspec import Meta

from common.config import Config
from lab.camera.plan import CameraSide
from lab.depth.config import SensorName
from lab.scenario import MAX_PEOPLE, RoomName
from people4d.errors import ConfigError
from people4d.validation import explain

NAME = "random"


class RandomScene(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Options of a random scene; the defaults resemble recordings of real people."""

    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 0  # seed of everything drawn
    density: Annotated[float, Meta(ge=0.005, le=1.0)] = 0.15  # [1/m2] people on the floor
    people: Annotated[int, Meta(ge=0, le=MAX_PEOPLE)] = 0  # number of people; 0: by density
    children: Annotated[int, Meta(ge=0, le=MAX_PEOPLE)] = 0  # number of children, 3 to 8 years
    wheelchairs: Annotated[int, Meta(ge=0, le=MAX_PEOPLE)] = 0  # number of people in wheelchairs
    objects: Annotated[int, Meta(ge=0, le=20)] = 0  # number of objects that look like people
    room: RoomName = "office"  # see scenario.room
    # robot: 1 to 1.2 m high; head: 1.5 to 1.8 m; ceiling: 2.2 m, tilted down and to a side
    view: Literal["robot", "head", "ceiling", "any"] = "any"
    outfit: Literal["own", "dark", "random", "mixed"] = "mixed"  # mixed: half dark
    furniture: bool = True  # True: desks, chairs, partitions, except in the square
    plain: bool = False  # True: without the errors of a low-cost camera
    depth_sensor: SensorName = "xtion"  # depth errors, see `lab.depth.config.SENSORS`
    duration_s: Annotated[float, Meta(ge=1, le=600)] = 15.0  # [s] duration of the recording
    fps: Annotated[float, Meta(ge=1, le=60)] = 10.0  # [Hz] frame rate
    width: CameraSide = 640  # [px] width of images
    height: CameraSide = 480  # [px] height of images
    # number of cameras; several: in the square, without furniture
    cameras: Annotated[int, Meta(ge=1, le=6)] = 1
    # ring: towards the centre; row: neighbours overlap slightly; apart: no overlap
    layout: Literal["ring", "row", "apart"] = "ring"
    row_m: Annotated[float, Meta(ge=1, le=6)] = 2.8  # [m] distance of cameras in a row
    clocks: Literal["alike", "free"] = "alike"  # free: different offsets, drifts and rates
    robot: bool = False  # True: the last camera is on a driving robot

    def __post_init__(self) -> None:
        """Check that a scene with a robot has a fixed camera."""
        super().__post_init__()
        if self.robot and self.cameras < 2:
            raise ValueError("robot: expected two cameras or more")

    @property
    def name(self) -> str:
        """Name of the scene's files: the options that differ from the default, except the seed."""
        usual = msgspec.structs.asdict(RandomScene())
        values = msgspec.structs.asdict(self).items()
        changed = [f"{key}={value}" for key, value in values if value != usual[key]]
        return "_".join([NAME, *(text for text in changed if not text.startswith("seed="))])


def read_options(name: str, seed: int | None = None) -> RandomScene:
    """Return the options in a name such as random?seed=7&density=0.2; `seed` replaces its seed.

    ConfigError if an option is unknown or out of range.
    """
    values = dict(parse_qsl(name.partition("?")[2], keep_blank_values=True))
    if seed is not None:
        values["seed"] = str(seed)
    try:
        return msgspec.convert(values, RandomScene, strict=False)
    except msgspec.ValidationError as error:
        fields = ", ".join(RandomScene.__struct_fields__)
        raise ConfigError(
            f"scenario {name}: {explain(error, values, '').lstrip('.: ')}", f"Options are {fields}."
        ) from error
