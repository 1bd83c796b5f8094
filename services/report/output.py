"""What the report puts out, and where it goes."""

from dataclasses import dataclass
from typing import Protocol

from people4d.messages import U8
from services.report.statistics import Summary


@dataclass(frozen=True, slots=True)
class Picture:
    """One annotated frame."""

    camera: str
    stamp_ns: int
    image: U8  # HxWx3, red first


class Output(Protocol):
    """Where the report goes."""

    def picture(self, picture: Picture) -> None:
        """Take the next frame of the video."""
        ...

    def finish(self, sheet: U8, summary: Summary) -> None:
        """Take the contact sheet (HxWx3, red first) and the summary; called once."""
        ...
