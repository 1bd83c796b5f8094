"""Configuration of the report."""

import msgspec


class ReportConfig(msgspec.Struct, frozen=True, kw_only=True):
    """Where the report is written and what it shows."""

    folder: str = "out"  # folder for contact_sheet.png, video, summary.txt and summary.json
    video: bool = True  # True: write an annotated MP4 of each camera
    sheet_frames: int = 12  # frames on the contact sheet, evenly spread over the run
    tile_width_px: int = 480  # [px] width of a frame on the contact sheet

    def __post_init__(self) -> None:
        """Check numbers."""
        if not 1 <= self.sheet_frames <= 100:
            raise ValueError(f"sheet_frames: expected 1 to 100, got {self.sheet_frames}")
        if not 160 <= self.tile_width_px <= 1920:
            raise ValueError(f"tile_width_px: expected 160 to 1920, got {self.tile_width_px}")
