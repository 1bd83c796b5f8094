"""Colours (red first), and functions that draw text and lines into an image."""

import cv2
import numpy as np
import numpy.typing as npt

from people4d.messages import U8

Colour = tuple[int, int, int]

PEOPLE: tuple[Colour, ...] = (
    (38, 132, 255),
    (255, 138, 30),
    (26, 166, 96),
    (222, 64, 160),
    (240, 190, 20),
    (20, 184, 200),
    (232, 70, 70),
    (140, 84, 232),
    (140, 186, 40),
    (160, 106, 60),
)
PAPER: Colour = (250, 250, 248)
INK: Colour = (32, 36, 42)
FAINT: Colour = (224, 226, 228)
GREY: Colour = (150, 154, 160)
WHITE: Colour = (255, 255, 255)

FONT = cv2.FONT_HERSHEY_SIMPLEX
UNIT_PX = 22.0  # approximate height of a line of text at scale 1 of the font [px]


def colour_of(track: int | None) -> Colour:
    """Return the colour of a track, the same in every drawing; grey without a track."""
    return GREY if track is None else PEOPLE[(track - 1) % len(PEOPLE)]


def ink_on(colour: Colour) -> Colour:
    """Return black or white, whichever contrasts more with a colour (ITU-R BT.601 luma)."""
    red, green, blue = colour
    return INK if 0.299 * red + 0.587 * green + 0.114 * blue > 150 else WHITE


def text_width(text: str, height_px: float) -> int:
    """Return the width of a text [px] at a height [px]."""
    (width, _), _ = cv2.getTextSize(text, FONT, height_px / UNIT_PX, 1)
    return width


def put_text(
    image: U8, text: str, left_base: tuple[float, float], height_px: float, colour: Colour = INK
) -> None:
    """Draw text that starts at the left end of its base line."""
    at = round(left_base[0]), round(left_base[1])
    cv2.putText(image, text, at, FONT, height_px / UNIT_PX, colour, 1, cv2.LINE_AA)


def put_label(
    image: U8, text: str, left_bottom: tuple[float, float], height_px: float, colour: Colour
) -> None:
    """Draw text on a filled plate with its left bottom corner at a point, inside the image."""
    pad = 0.3 * height_px
    width, height = text_width(text, height_px) + 2 * pad, height_px + 2 * pad
    left = min(max(left_bottom[0], 0), image.shape[1] - width)
    bottom = min(max(left_bottom[1], height), image.shape[0])
    corners = (round(left), round(bottom - height)), (round(left + width), round(bottom))
    cv2.rectangle(image, *corners, colour, cv2.FILLED)
    put_text(image, text, (left + pad, bottom - 1.5 * pad), height_px, ink_on(colour))


def put_path(image: U8, points: npt.ArrayLike, colour: Colour, thickness: int = 2) -> None:
    """Draw a polyline through Nx2 points in pixels."""
    fixed = np.round(np.asarray(points, np.float64) * 16).astype(np.int32)  # 4 fractional bits
    cv2.polylines(image, [fixed], False, colour, thickness, cv2.LINE_AA, 4)
