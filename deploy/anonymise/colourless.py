"""Messages without the appearance of people."""

import msgspec
import numpy as np

from common.io.image_header import image_size
from common.io.images import encode_jpeg
from people4d.messages import CompressedRgbdFrame, Crops, Embeddings, Message, RgbdFrame

GREY = 128  # brightness of the grey images
LEFT_OUT = (Crops, Embeddings)


def without_colour(message: Message) -> Message | None:
    """Return a message with grey images, None for crops and embeddings; or DecodeError."""
    if isinstance(message, LEFT_OUT):
        return None
    if isinstance(message, RgbdFrame):
        return msgspec.structs.replace(message, rgb=np.full_like(message.rgb, GREY))
    return grey_frame(message) if isinstance(message, CompressedRgbdFrame) else message


def grey_frame(frame: CompressedRgbdFrame) -> CompressedRgbdFrame:
    """Return a compressed frame with a grey image of its size; DecodeError if it has none."""
    width, height = image_size(frame.rgb_jpeg, "rgb_jpeg")
    grey = np.full((height, width, 3), GREY, np.uint8)
    return msgspec.structs.replace(frame, rgb_jpeg=encode_jpeg(grey))
