"""The people models by kind, and loading one as configured.

The kind of a file is found by the shapes of its outputs in a run on one image.
"""

from collections.abc import Callable, Mapping, Sequence
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
    "yolo-boxes": "services.detector.models.yolo:YoloBoxes",
    "rtmo": "services.detector.models.rtmo:Rtmo",
    "rtmpose": "services.detector.models.rtmpose:RtmPose",
}
BOXES = "yolo-boxes"  # kind of networks that find boxes only
Shape: TypeAlias = tuple[int | None, ...]
# Shapes of the outputs by kind, fewest axes first; None: any length. The first match counts
OUTPUTS: tuple[tuple[str, tuple[Shape, ...]], ...] = (
    ("yolov8-pose", ((1, 56, None),)),
    ("yolov8-pose", ((1, None, 57),)),  # NMS inside
    ("yolov8-seg", ((1, None, None), (1, 32, None, None))),  # with or without NMS inside
    ("rtmo", ((1, None, 5), (1, None, 17, 3))),
    *(("rtmpose", ((1, points, None),) * 2) for points in (17, 26, 133)),
    (BOXES, ((1, None, 6),)),
    (BOXES, ((1, 84, None),)),  # COCO's classes
    (BOXES, ((1, 5, None),)),  # people only
)
# Builds a model of one kind, by its name; raises ModelError if the network is not of this kind.
Factory: TypeAlias = Callable[[Session, ModelSettings, str], PersonModel]
BOXES_HINT = (
    "A position needs keypoints or a mask: export a pose or a segmentation model, or set "
    "detector.boxes to this file and detector.model to an RTMPose network."
)
PROBE_SIZE = (256, 320)  # size of the probe image of a network of any size and unknown kind [px]


def load_model(settings: ModelSettings) -> PersonModel:
    """Find, check and load the configured model.

    Raises:
        ConfigError: The kind is unknown or cannot be loaded.
        ModelError: The file is absent, altered or not a people model of its kind.
    """
    return _load(settings, boxes=False)


def load_boxes(settings: ModelSettings) -> PersonModel:
    """Load a model of boxes, for keypoints in boxes; it may have keypoints or masks, too.

    Raises:
        ConfigError: The kind is unknown or cannot be loaded.
        ModelError: The file is absent, altered or not a people model of its kind.
    """
    return _load(settings, boxes=True)


def _load(settings: ModelSettings, boxes: bool) -> PersonModel:
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
    if kind == BOXES and not boxes:
        raise ModelError(f"model file {path} finds boxes only", BOXES_HINT)
    return factory(session, settings, name or f"{kind}:{path.stem}")


def check_model(settings: ModelSettings) -> None:
    """Check that the configured model can be loaded, without loading it.

    Raises:
        ConfigError: The kind is unknown or cannot be loaded.
        ModelError: The file is absent or altered.
    """
    for model in filter(None, (settings.model, settings.boxes)):
        weights.locate(model, settings.folder)
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
        known = "; ".join(f"{name} {_text(shapes)}" for name, shapes in OUTPUTS)
        raise ModelError(
            f"model file {path} has an unsupported format: its outputs are {got}",
            f"Known outputs: {known}; movenet by names. Set kind to one of {', '.join(MODELS)}, "
            "or to module:Class of your own.",
        )
    return kind


def kind_of(outputs: Mapping[str, Array]) -> str:
    """Return the kind with such outputs, or an empty text."""
    if any(
        maps <= outputs.keys() for maps in ({"center_map", "kpt_map"}, {"center", "kpt_heatmap"})
    ):
        return "movenet"
    got = sorted((array.shape for array in outputs.values()), key=len)
    return next((kind for kind, shapes in OUTPUTS if _fits(got, shapes)), "")


def _fits(got: Sequence[tuple[int, ...]], shapes: Sequence[Shape]) -> bool:
    return [len(shape) for shape in got] == [len(shape) for shape in shapes] and all(
        want in (None, length)
        for lengths, wants in zip(got, shapes, strict=True)
        for length, want in zip(lengths, wants, strict=True)
    )


def _text(shapes: Sequence[Shape]) -> str:
    return " and ".join("x".join(str(n or "N") for n in shape) for shape in shapes)
