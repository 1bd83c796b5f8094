"""Configuration of the report."""

from typing import Annotated

from msgspec import Meta

from common.config import Config
from people4d.messages.base import Text


class ReportConfig(Config, frozen=True, kw_only=True):
    """ReportFolder and content of the report."""

    folder: str = (
        "out"  # folder for report.html, contact_sheet.png, video, summary.txt and summary.json
    )
    video: bool = True  # True: write an annotated video of each camera
    sheet_frames: Annotated[int, Meta(ge=1, le=100)] = 12  # frames on the sheet, evenly spread
    truth: Text = ""  # ground truth that was asked for; the run had limits if none came
    note: Text = ""  # sentence on the page about simulated data
    tile_width_px: Annotated[int, Meta(ge=160, le=1920)] = 480  # width of a frame on the sheet [px]
