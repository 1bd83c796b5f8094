"""People models around a network: its image input, and the run from image to people."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, TypeAlias

import numpy as np

from common.inference.session import Array, Session
from common.transport.trace import span
from people4d.errors import ModelError
from people4d.messages import U8
from services.detector.config import SIDE_STEP, ModelSettings
from services.detector.models.base import DetectedPerson, Limits
from services.detector.models.letterbox import Letterbox
from services.detector.models.scores import ScoreCalibration

Outputs: TypeAlias = Mapping[str, Array]  # outputs of a run by name


@dataclass(frozen=True)
class ImageInput:
    """Size, layout and number type of a network's image."""

    height: int  # [px]
    width: int  # [px]
    channels_first: bool  # 1x3xHxW, else 1xHxWx3
    dtype: np.dtype[np.generic]  # type of the elements: uint8 or a float type

    @classmethod
    def from_session(
        cls, session: Session, settings: ModelSettings, default_size: tuple[int, int]
    ) -> "ImageInput":
        """Read the input of a network; for one of any size, settings or the default apply.

        Raises:
            ModelError: The input is not a single colour image of that size.
        """
        shape = session.input_shape
        channels_first = len(shape) == 4 and shape[1] == 3
        if len(shape) != 4 or shape[0] not in (1, None) or 3 not in (shape[1], shape[3]):
            raise ModelError(f"model input: expected 1x3xHxW or 1xHxWx3, got {_text(shape)}")
        fixed = (shape[2], shape[3]) if channels_first else (shape[1], shape[2])
        chosen = (settings.input_height, settings.input_width)
        if not any(chosen):
            chosen = default_size
            chosen = (fixed[0] or chosen[0], fixed[1] or chosen[1])
        if any(want not in (None, got) for want, got in zip(fixed, chosen, strict=True)):
            raise ModelError(
                f"model input: the file is made for {_text(fixed)}, got {_text(chosen)}",
                "Leave input_height and input_width out, or export the model again.",
            )
        if any(side % SIDE_STEP for side in chosen):
            raise ModelError(
                f"model input: expected multiples of {SIDE_STEP}, got {_text(chosen)}",
                "Export the model again with such a size.",
            )
        return cls(*chosen, channels_first, session.input_dtype)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return self.height, self.width

    def prepare(self, rgb: U8, grey: int, highest: float) -> tuple[Letterbox, Array]:
        """Fit an image (HxWx3) of any size into the network's input.

        Bars around the image are `grey`; if the network takes floats, the byte 255 is `highest`.

        Returns:
            Position of the image in the input, and the input array.
        """
        letterbox = Letterbox.fit((rgb.shape[0], rgb.shape[1]), self.size)
        return letterbox, self.tensor(letterbox.fill(rgb, grey), highest)

    def tensor(self, image: U8, highest: float) -> Array:
        """Return the input array of an image (HxWx3) of this size."""
        planes = image.transpose(2, 0, 1) if self.channels_first else image
        if self.dtype == np.uint8:
            return np.ascontiguousarray(planes)[None]
        out = np.empty((1, *planes.shape), np.float32)
        np.multiply(planes, np.float32(highest / 255), out=out[0])
        return out.astype(self.dtype, copy=False)

    def try_out(self, session: Session, name: str) -> Mapping[str, Array]:
        """Run a network once on a black image, since the first run is slow; return its outputs.

        Raises:
            ModelError: The network cannot be run on one image.
        """
        black = np.zeros((self.height, self.width, 3), np.uint8)
        try:
            return session.run(self.tensor(black, highest=1.0))
        except Exception as error:  # inference libraries raise their own types
            reason = (str(error).splitlines() or [""])[0][:200]
            raise ModelError(f"{name}: cannot be run on an image: {reason}") from error


class NetworkModel:
    """A people model around a network; each kind reads the people from the network's outputs.

    Args:
        session: Session of the network.
        settings: Thresholds and input size.
        name: Name of the model, for results; empty: its kind.

    Raises:
        ModelError: The network lacks the input or the outputs of this kind.
    """

    kind: ClassVar[str]
    default_size: ClassVar[tuple[int, int]]  # [px] height, width
    default_limits: ClassVar[tuple[float, float]]  # minimum score, maximum overlap
    grey: ClassVar[int]  # value of the bars around an image, as in the network's training
    highest: ClassVar[float]  # value of the byte 255 if the network takes floats
    calibration: ClassVar[ScoreCalibration]  # calibration of scores

    def __init__(self, session: Session, settings: ModelSettings, name: str = "") -> None:
        self.name = name or self.kind
        self._session = session
        self._input = ImageInput.from_session(session, settings, self.default_size)
        self._limits = Limits.from_settings(settings, *self.default_limits)
        self._score_scale = settings.score_scale
        self._calibrated = settings.scores == "probability"
        self._check(self._input.try_out(session, self.name))

    def detect(self, rgb: U8) -> list[DetectedPerson]:
        """Find people in an HxWx3 colour image, best score first."""
        with span("preprocess"):
            letterbox, image = self.input_of(rgb)
        outputs = self._session.run(image)
        with span("postprocess"):
            return self._scored(self._people(outputs, letterbox))

    def input_of(self, rgb: U8) -> tuple[Letterbox, Array]:
        """Return the position of an image (HxWx3) in the network's input, and that input."""
        return self._input.prepare(rgb, self.grey, self.highest)

    def _scored(self, people: Sequence[DetectedPerson]) -> list[DetectedPerson]:
        """Return people with the published scores."""
        scores = np.minimum(np.array([person.score for person in people]) / self._score_scale, 1.0)
        if self._calibrated:
            scores = self.calibration.probability(scores)
        return [
            replace(person, score=score)
            for person, score in zip(people, scores.tolist(), strict=True)
        ]

    def _check(self, outputs: Outputs) -> None:
        """Check that a run has the outputs of this kind."""
        raise NotImplementedError

    def _people(self, outputs: Outputs, letterbox: Letterbox) -> list[DetectedPerson]:
        raise NotImplementedError


def check_output(
    outputs: Mapping[str, Array], name: str, shape: tuple[int | None, ...], model: str
) -> None:
    """Check the shape of one output of a run; None is any length.

    Raises:
        ModelError: The output is absent or of another shape.
    """
    array = outputs.get(name)
    if array is None:
        raise ModelError(f"{model}: expected an output {name}, got {', '.join(outputs)}")
    wrong = [want not in (None, got) for want, got in zip(shape, array.shape, strict=False)]
    if array.ndim != len(shape) or any(wrong):
        raise ModelError(f"{model}: expected {name} of {_text(shape)}, got {_text(array.shape)}")


def _text(shape: tuple[int | None, ...]) -> str:
    return "x".join("any" if length is None else str(length) for length in shape)
