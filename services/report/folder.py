"""The files of the report."""

import logging
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import cv2
import msgspec
import numpy as np

from common.drawing.video import VideoWriter
from people4d.errors import ConfigError, People4dError
from people4d.messages import U8
from services.report.config import ReportConfig
from services.report.page import RunPage
from services.report.text import text

PAGE = "report.html"
COMPLETE = "summary.json"  # written last, and renamed: if it exists, the report is complete
RATE_FRAMES = 10  # frames from whose stamps the rate of a video is measured
HZ_RANGE = 1.0, 120.0

log = logging.getLogger("people4d")


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

    def finish(self, sheet: U8, page: RunPage) -> None:
        """Take the contact sheet (HxWx3, red first) and the page; called once."""
        ...


class ReportFolder:
    """Writes the report into a folder, and its summary to standard output.

    Raises:
        ConfigError: The folder cannot be made or written to.
    """

    def __init__(self, config: ReportConfig) -> None:
        check_folder(config)
        self._path = Path(config.folder)
        self._videos: dict[str, VideoFile] = {}

    def add_frame(self, frame: AnnotatedFrame) -> None:
        """Append a frame to the video of its camera."""
        if frame.camera not in self._videos:
            self._videos[frame.camera] = VideoFile(self._path / f"people_{frame.camera}.webm")
        self._videos[frame.camera].write(frame)

    def finish(self, sheet: U8, page: RunPage) -> None:
        """Write everything else.

        Raises:
            People4dError: A file cannot be written, for example because the disk is full.
        """
        for video in self._videos.values():
            video.close()
        summary, words = page.summary, text(page.summary)
        videos = {n: v.path for n, v in sorted(self._videos.items()) if v.path.is_file()}
        json = msgspec.json.format(msgspec.json.encode(summary), indent=2)
        _, png = cv2.imencode(".png", cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))
        try:
            (self._path / "contact_sheet.png").write_bytes(png.tobytes())
            (self._path / "summary.txt").write_text(words, encoding="utf-8")
            html = replace(page, videos=videos).html()
            (self._path / PAGE).write_text(html, encoding="utf-8")
            part = self._path / f"{COMPLETE}.part"
            part.write_bytes(json + b"\n")
            part.replace(self._path / COMPLETE)
        except OSError as error:
            raise People4dError(
                f"the report cannot be written to {self._path}: {error.strerror}",
                "The files there are not complete.",
            ) from error
        sys.stdout.write(words)
        sys.stdout.flush()


def check_folder(config: ReportConfig) -> None:
    """Make the folder of the report, marked as not complete.

    Raises:
        ConfigError: The folder cannot be made or written to.
    """
    path = Path(config.folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
        (path / "summary.txt").write_text("The run has not ended yet.\n", encoding="utf-8")
        (path / COMPLETE).unlink(missing_ok=True)
    except OSError as error:
        raise ConfigError(
            f"folder {path} cannot be written: {error.strerror}", "Set folder to another one."
        ) from error


class VideoFile:
    """A video whose rate comes from the stamps of its first frames."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._waiting: list[AnnotatedFrame] = []  # not written yet
        self._writer: VideoWriter | None = None
        self._size = (0, 0)
        self._failed = False

    def write(self, frame: AnnotatedFrame) -> None:
        """Append a frame; one of another size than the first is scaled to it."""
        if self._failed:
            return
        self._waiting.append(frame)
        if self._writer or len(self._waiting) >= RATE_FRAMES:
            self._try(self._write_waiting)

    def close(self) -> None:
        """Finish the file."""
        self._try(self._write_waiting)
        if self._writer:
            self._try(self._writer.close)

    def _try(self, work: Callable[[], None]) -> None:
        try:
            if not self._failed:
                work()
        except People4dError as error:
            log.warning("%s; the other files are", error.problem)
            self._failed = True

    def _write_waiting(self) -> None:
        if not self._waiting:
            return
        if self._writer is None:
            height, width = self._waiting[0].image.shape[:2]
            self._size = width, height
            rate_hz = frame_rate_hz([frame.stamp_ns for frame in self._waiting])
            self._writer = VideoWriter(self.path, rate_hz, self._size)
        for frame in self._waiting:
            image = frame.image
            if image.shape[1::-1] != self._size:
                scaled = cv2.resize(image, self._size, interpolation=cv2.INTER_AREA)
                image = scaled.astype(np.uint8)
            self._writer.write(image)
        self._waiting.clear()


def frame_rate_hz(stamps_ns: list[int]) -> float:
    """Return the rate of frames by the median of their intervals, 30 where there is none."""
    intervals = np.diff(stamps_ns) / 1e9
    rising = intervals[intervals > 0]
    return float(np.clip(1 / np.median(rising), *HZ_RANGE)) if len(rising) else 30.0
