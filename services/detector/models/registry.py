"""The people models by kind, and loading one as configured."""

from collections.abc import Callable, Mapping
from typing import TypeAlias

import msgspec

from common import registry
from common.inference.cores import DETECTOR
from common.inference.engines import open_session
from common.inference.session import Array, Session
from common.io import weights
from people4d.errors import ModelError
from services.detector.config import ModelSettings
from services.detector.models.base import PersonModel
from services.detector.models.network import ImageInput

MODELS: dict[str, str] = {
    "movenet": "services.detector.models.movenet:MoveNet",
    "yolov8-pose": "services.detector.models.yolo:YoloPose",
    "yolov8-seg": "services.detector.models.yolo_seg:YoloSeg",
}
# Builds a model of one kind, by its name; raises ModelError if the network is not of this kind.
Factory: TypeAlias = Callable[[Session, ModelSettings, str], PersonModel]
PROBE_SIZE = (256, 320)  # size of the probe image of a network of any size and unknown kind [px]


def load_model(settings: ModelSettings) -> PersonModel:
    """Find, check and load the configured model.

    Raises:
        ConfigError: The kind is unknown or cannot be loaded.
        ModelError: The file is absent, altered or not a people model of its kind.
    """
    path, entry = weights.locate(settings.model, settings.folder)
    kind, name = settings.kind, ""
    if entry:
        kind, name = settings.kind or entry.kind, entry.name
        scale = settings.score_scale * entry.score_scale
        settings = msgspec.structs.replace(settings, score_scale=scale)
    factory = find_factory(kind) if kind else None
    session = open_session(path, settings.threads, settings.engine, DETECTOR)
    if factory is None:
        kind = recognise(session, settings, str(path))
        factory = find_factory(kind)
    return factory(session, settings, name or f"{kind}:{path.stem}")


def check_model(settings: ModelSettings) -> None:
    """Check that the configured model can be loaded, without loading it.

    Raises:
        ConfigError: The kind is unknown or cannot be loaded.
        ModelError: The file is absent or altered.
    """
    weights.locate(settings.model, settings.folder)
    if settings.kind:
        find_factory(settings.kind)


def find_factory(kind: str) -> Factory:
    """Return the factory of a kind: a name in MODELS, or "module:Class" of a class like `Factory`.

    Raises:
        ConfigError: The kind is unknown or cannot be imported.
    """
    factory: Factory = registry.find("people model", MODELS, kind)
    return factory


def recognise(session: Session, settings: ModelSettings, path: str) -> str:
    """Return the kind of a network by the shapes of its outputs.

    Raises:
        ModelError: No kind has such outputs.
    """
    outputs = ImageInput.from_session(session, settings, PROBE_SIZE).try_out(session, path)
    kind = kind_of(outputs)
    if not kind:
        got = ", ".join(f"{name} {array.shape}" for name, array in outputs.items())
        if any(_has_boxes_only(array) for array in outputs.values()):
            raise ModelError(
                f"model file {path} finds boxes only: its outputs are {got}",
                "A position needs keypoints or a mask: export a pose or a segmentation model.",
            )
        hint = f"Set kind to one of {', '.join(MODELS)}, or to module:Class of your own."
        raise ModelError(
            f"model file {path} has an unsupported format: its outputs are {got}", hint
        )
    return kind


def kind_of(outputs: Mapping[str, Array]) -> str:
    """Return the kind with such outputs, or an empty text."""
    if any(
        maps <= outputs.keys() for maps in ({"center_map", "kpt_map"}, {"center", "kpt_heatmap"})
    ):
        return "movenet"
    shapes = {array.ndim: array.shape for array in outputs.values() if array.ndim in (3, 4)}
    if shapes.keys() == {3} and (shapes[3][1] == 56 or shapes[3][2] == 57):  # 57: with NMS inside
        return "yolov8-pose"
    masks = shapes.keys() == {3, 4} and shapes[4][1] == 32
    return "yolov8-seg" if masks and (shapes[3][1] == 116 or shapes[3][2] == 38) else ""


def _has_boxes_only(output: Array) -> bool:
    """Check for the boxes of a detection network: 1x(4+classes)xN, or with NMS inside 1xNx6."""
    shape = output.shape
    return output.ndim == 3 and (shape[2] == 6 or shape[1] in (5, 84))
