"""Mapping of an image into a network's input, and back.

Positions are continuous: pixel i covers [i, i + 1), the image [0, width]. A change of size is a
plain factor, as in cv2.resize. The index of a pixel, as cameras and OpenCV count, is the position
of its centre minus one half.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from people4d.messages import F64, U8


@dataclass(frozen=True)
class Letterbox:
    """An image scaled with its aspect kept and centred between two bars."""

    input_height: int  # [px] height of the network's input
    input_width: int  # [px]
    height: int  # [px] height of the scaled image
    width: int  # [px]
    top: int  # [px] bar above the scaled image
    left: int  # [px] bar left of the scaled image
    scale_x: float  # scaled width / image width; differs from scale_y by rounding to pixels
    scale_y: float  # scaled height / image height

    @property
    def image_size(self) -> tuple[int, int]:
        """Height and width of the image in pixels."""
        return round(self.height / self.scale_y), round(self.width / self.scale_x)

    @classmethod
    def fit(cls, image_size: tuple[int, int], input_size: tuple[int, int]) -> "Letterbox":
        """Find the largest part of the input that holds the full image; sizes are height, width."""
        image_height, image_width = image_size
        input_height, input_width = input_size
        scale = min(input_height / image_height, input_width / image_width)
        height = max(1, round(image_height * scale))
        width = max(1, round(image_width * scale))
        return cls(
            input_height=input_height,
            input_width=input_width,
            height=height,
            width=width,
            top=(input_height - height) // 2,
            left=(input_width - width) // 2,
            scale_x=width / image_width,
            scale_y=height / image_height,
        )

    def fill(self, rgb: U8, grey: int) -> U8:
        """Return the network's input (HxWx3) of an image of the size given to `fit`, bars grey."""
        shape = (self.input_height, self.input_width, 3)
        canvas = np.full(shape, grey, np.uint8)
        inside = canvas[self.top : self.top + self.height, self.left : self.left + self.width]
        if rgb.shape == inside.shape:
            inside[:] = rgb
        else:
            method = cv2.INTER_AREA if self.scale_x < 1 else cv2.INTER_LINEAR
            inside[:] = cv2.resize(rgb, (self.width, self.height), interpolation=method)
        return canvas

    def to_image(self, positions: npt.ArrayLike) -> F64:
        """Map positions (...x2 or ...x4 xyxy) in the network's input to the image, unclipped."""
        points = np.asarray(positions, np.float64)
        pairs = (points.reshape(-1, 2) - (self.left, self.top)) / (self.scale_x, self.scale_y)
        return pairs.reshape(points.shape)
