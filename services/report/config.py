"""Configuration of the report."""

from typing import Annotated

from msgspec import Meta

from common.config import Config
from people4d.messages.base import Text


class ReportConfig(Config, frozen=True, kw_only=True):
    """Folder and content of the report."""

    # folder for report.html, contact_sheet.png, video, summary.txt and summary.json
    folder: str = "out"
    video: bool = True  # True: write an annotated video of each camera
    # Number of frames on the sheet, evenly spread
    sheet_frames: Annotated[int, Meta(ge=1, le=100)] = 12
    truth: Text = ""  # source of ground truth; if its messages are missing, the report says so
    note: Text = ""  # sentence on the page about simulated data
