"""What a people model takes and gives."""

from dataclasses import dataclass
from typing import Protocol

import msgspec

from people4d.messages import F32, U8

SIDE_STEP = 32  # [px] the networks halve the image five times


@dataclass(frozen=True)
class InstanceMask:
    """Pixels of one person inside a window of the image."""

    window: U8  # HxW, 1 = person
    x_px: int  # [px] column of the window's first pixel
    y_px: int  # [px] row of the window's first pixel


@dataclass(frozen=True)
class Person:
    """One person found in an image, in pixels of that image."""

    score: float  # 0 to 1
    box_xyxy_px: F32  # [px] 4: left, top, right, bottom edge; may reach beyond the image
    keypoints: F32 | None = None  # [px] 17x3: u, v, confidence 0 to 1, COCO order; absent if none
    mask: InstanceMask | None = None  # absent if the model gives none


class PersonModel(Protocol):
    """Finds people in a colour image; may be called from several threads at once."""

    name: str  # by which results say where they come from

    def detect(self, rgb: U8) -> list[Person]:
        """Find people.

        Args:
            rgb: HxWx3 colour image.

        Returns:
            The people, best score first.
        """
        ...


class ModelSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Which people model runs, and how."""

    model: str = "movenet-multipose"  # name in models/models.toml, or path of an .onnx file
    kind: str = ""  # one of MODELS or "module:Class"; empty: as the manifest or the file says
    folder: str = ""  # folder that is searched first for named models; empty: none
    input_height: int = 0  # [px] of the network, a multiple of 32; 0: as the model is made
    input_width: int = 0  # [px] of the network, a multiple of 32; 0: as the model is made
    score_min: float | None = (
        None  # people below this score are dropped; absent: the kind's default
    )
    iou_max: float | None = None  # overlap above which two boxes are one person; absent: default
    threads: int = 1  # threads that one inference may use
    max_people: int = 20  # people given for one image at most, best first

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            ValueError: A value is out of range.
        """
        for field in ("input_height", "input_width"):
            side = getattr(self, field)
            if side < 0 or side % SIDE_STEP:
                raise ValueError(f"{field}: expected a multiple of {SIDE_STEP} or 0, got {side}")
        if (self.input_height == 0) != (self.input_width == 0):
            raise ValueError("input_height, input_width: expected both or neither, got one")
        for field in ("score_min", "iou_max"):
            share = getattr(self, field)
            if share is not None and not 0 <= share <= 1:
                raise ValueError(f"{field}: expected 0 to 1, got {share}")
        for field in ("threads", "max_people"):
            if getattr(self, field) < 1:
                raise ValueError(f"{field}: expected at least 1, got {getattr(self, field)}")


@dataclass(frozen=True)
class Limits:
    """What counts as a person, and as the same one."""

    score_min: float
    iou_max: float  # of two people's boxes
    max_people: int

    @classmethod
    def of(cls, settings: ModelSettings, score_min: float, iou_max: float) -> "Limits":
        """Return the settings, with the given values where nothing is said."""
        return cls(
            score_min=score_min if settings.score_min is None else settings.score_min,
            iou_max=iou_max if settings.iou_max is None else settings.iou_max,
            max_people=settings.max_people,
        )
