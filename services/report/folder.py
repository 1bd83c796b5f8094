"""The files of the report."""

import logging
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import cv2
import msgspec
import numpy as np

from common.drawing.video import VideoWriter
from common.io.images import decode_jpeg, encode_jpeg
from people4d.errors import ConfigError, People4dError
from people4d.messages import U8
from services.report.config import ReportConfig
from services.report.page import RunPage
from services.report.text import text

PAGE = "report.html"
COMPLETE = "summary.json"  # name of the file that is written last, so it marks a complete report
HZ_RANGE = 1.0, 120.0
WAITING_MAX = 2 * 2**30  # [bytes] maximum size of all frames waiting for the end of the run
ENCODING_S = 540.0  # [s] time limit for encoding all videos, below the 600 s of the compose file
PROGRESS_S = 2.0

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
        """Add the next frame of the video."""
        ...

    def finish(self, sheet: U8, page: RunPage) -> None:
        """Write the contact sheet (HxWx3, red first) and the page; called once."""
        ...


class ReportFolder:
    """Writes the report into a folder, and its summary to the output; ConfigError if it cannot."""

    def __init__(self, config: ReportConfig) -> None:
        check_folder(config)
        self._path = Path(config.folder)
        self._videos: dict[str, VideoFile] = {}

    def add_frame(self, frame: AnnotatedFrame) -> None:
        """Append a frame to the video of its camera."""
        if frame.camera not in self._videos:
            self._videos[frame.camera] = VideoFile(self._path / f"people_{frame.camera}.webm")
        waiting_bytes = sum(video.waiting_bytes for video in self._videos.values())
        self._videos[frame.camera].add_frame(frame, waiting_bytes < WAITING_MAX)

    def finish(self, sheet: U8, page: RunPage) -> None:
        """Write videos, sheet, page and summary; People4dError if a file cannot be written."""
        deadline_s = time.monotonic() + ENCODING_S
        for video in self._videos.values():
            video.encode(deadline_s)
        limits = [video.limit for video in self._videos.values() if video.limit]
        degraded = (*page.summary.degraded, *limits)
        summary = msgspec.structs.replace(page.summary, degraded=degraded)
        page, words = replace(page, summary=summary), text(summary)
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
    """Create the folder of the report, marked as incomplete; ConfigError if it cannot."""
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
    """A video that is encoded after the run, since encoding would delay the pipeline.

    Until then its frames wait as JPEG in a temporary file of the same folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.waiting_bytes = 0
        self.limit = ""  # message on missing frames; empty if complete
        self._file = tempfile.TemporaryFile(dir=path.parent)  # noqa: SIM115 (it outlives this)
        self._frames: list[tuple[int, int]] = []  # stamp, and number of bytes
        self._count = self._written = 0

    def add_frame(self, frame: AnnotatedFrame, has_room: bool) -> None:
        """Append a frame; without room it is only counted."""
        self._count += 1
        jpeg = encode_jpeg(frame.image) if has_room else b""
        with suppress(OSError):  # the disk is full
            if self._file.write(jpeg):
                self.waiting_bytes += len(jpeg)
                self._frames.append((frame.stamp_ns, len(jpeg)))

    def encode(self, deadline_s: float) -> None:
        """Write the file; frames after the deadline (monotonic time) are omitted."""
        self._file.seek(0)
        try:
            with self._file:
                self._encode(deadline_s)
        except (People4dError, OSError) as error:
            log.warning("%s; the other files are", getattr(error, "problem", error))
        if missing := self._count - self._written:
            self.limit = f"report: {self.path.name} lacks {missing} of {self._count} frames"

    def _encode(self, deadline_s: float) -> None:
        """Write all frames, scaled to the first one."""
        writer, size = None, (0, 0)
        shown_s = time.monotonic() + PROGRESS_S
        for _, length in self._frames:
            image = decode_jpeg(self._file.read(length))
            if writer is None:
                size = image.shape[1], image.shape[0]
                rate_hz = frame_rate_hz([stamp_ns for stamp_ns, _ in self._frames])
                writer = VideoWriter(self.path, rate_hz, size)
            if image.shape[1::-1] != size:
                image = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
            writer.write(image)
            self._written += 1
            if (now_s := time.monotonic()) > deadline_s:
                break
            if now_s > shown_s:
                shown_s = now_s + PROGRESS_S
                log.info("%s: %d of %d frames", self.path.name, self._written, self._count)
        if writer:
            writer.close()


def frame_rate_hz(stamps_ns: list[int]) -> float:
    """Return the frame rate from the median interval; 30 Hz if there is no interval."""
    intervals = np.diff(stamps_ns) / 1e9
    rising = intervals[intervals > 0]
    return float(np.clip(1 / np.median(rising), *HZ_RANGE)) if len(rising) else 30.0
