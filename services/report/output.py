"""Outputs of the report."""

from dataclasses import dataclass
from typing import Protocol

from people4d.messages import U8
from services.report.statistics import RunSummary


@dataclass(frozen=True, slots=True)
class AnnotatedFrame:
    """One annotated frame."""

    camera: str
    stamp_ns: int
    image: U8  # HxWx3, red first


class ReportOutput(Protocol):
    """Destination of the report."""

    def add_frame(self, frame: AnnotatedFrame) -> None:
        """Take the next frame of the video."""
        ...

    def finish(self, sheet: U8, summary: RunSummary) -> None:
        """Take the contact sheet (HxWx3, red first) and the summary; called once."""
        ...
