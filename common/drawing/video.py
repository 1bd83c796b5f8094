"""Videos that every browser plays: VP8 in WebM.

The OpenCV wheels cannot encode H.264; a frame of 1280x480 takes 150 ms in VP9 and 25 ms in VP8.
"""

from pathlib import Path

import cv2

from people4d.errors import People4dError

SUFFIX = ".webm"


def open_video(path: Path, rate_hz: float, size_px: tuple[int, int]) -> cv2.VideoWriter:
    """Open a .webm file for writing; `write` takes BGR images, `release` finishes the file.

    Raises:
        People4dError: The file cannot be written.
    """
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"VP80"), rate_hz, size_px)
    if path.suffix != SUFFIX or not writer.isOpened():
        raise People4dError(f"video {path} cannot be written", "Is the folder there and writable?")
    return writer
