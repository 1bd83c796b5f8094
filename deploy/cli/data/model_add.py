"""Command `people4d models add`."""

import shutil
import statistics
import time
from itertools import islice
from pathlib import Path
from typing import Annotated

import typer

from common.inference.engines import open_session
from common.io.images import decode_jpeg
from common.io.recording import open_recording
from common.io.weights import (
    FILE_NAME,
    MANIFEST,
    ModelFile,
    checksum,
    load_manifest,
    own_folder,
    write_manifest,
)
from deploy.cli.system.demo import DEMO
from deploy.cli.terminal import console
from people4d.errors import ModelError
from people4d.messages import U8, CompressedRgbdFrame
from services.detector.config import ModelSettings
from services.detector.models.base import PersonModel
from services.detector.models.registry import find_factory, recognise

FRAME = 60  # number of the tried frame in the shipped recording, with three people
RUNS = 10
NO_MASKS = 'no masks: position = "mask" is not possible'
UNCALIBRATED = "no calibration of scores: YOLOv8's is used"
LACKS = {  # missing features by kind
    "movenet": NO_MASKS,
    "yolov8-pose": NO_MASKS,
    "yolov8-seg": "no keypoints: no yaw, no skeletons and no points of gait",
    "yolo-boxes": "no keypoints and no masks: only for detector.boxes of an RTMPose network",
    "rtmo": f"{NO_MASKS}; {UNCALIBRATED}",
    "rtmpose": "no boxes: detector.boxes names their model, else the shipped one finds them",
}


def add(
    file: Annotated[Path, typer.Argument(help="The .onnx file.")],
    name: Annotated[str, typer.Option(help="Name in configurations; default: of the file.")] = "",
) -> None:
    """Add a model: recognise its kind, try it on a frame, copy it to your models."""
    name = name or file.stem
    check_name(name, file)
    session = open_session(file)
    kind = recognise(session, ModelSettings(), str(file))
    people, time_ms = measure(find_factory(kind)(session, ModelSettings(), name))
    size = "x".join(str(n or "any") for n in session.input_shape)
    console.print(
        f"{file.name}: kind {kind}, input {size}. In a frame with three people it found {people}, "
        f"in {time_ms:.1f} ms on one thread.\nIt has {LACKS[kind]}.",
        markup=False,
    )
    entry = ModelFile(
        name=name,
        kind=kind,
        file=f"{name}.onnx",
        licence="your own file: see its source",
        input=size,
        get=f"Added from {file.absolute()}",
        sha256=checksum(file),
    )
    write_entry(entry, file)
    key = "boxes" if kind == "yolo-boxes" else "model"
    console.print(f'Added. Use it: [detector] {key} = "{name}"', markup=False)


def check_name(name: str, file: Path) -> None:
    """Check the name of a new model and the type of its file, or raise ModelError."""
    if not file.is_file():
        raise ModelError(f"model file {file} does not exist", "Check the path.")
    if file.suffix != ".onnx":
        raise ModelError(f"{file} is not an .onnx file", "Export the network to ONNX first.")
    if not FILE_NAME.fullmatch(name):
        raise ModelError(f"name {name!r} is not plain", "Choose letters, digits, - . _ by --name.")
    shipped = load_manifest().get(name)
    if shipped is not None and shipped.sha256:
        raise ModelError(f"model {name} is another file", "Choose another name by --name.")


def measure(model: PersonModel) -> tuple[int, float]:
    """Return the number of people in a frame, and the median time of some runs [ms]."""
    rgb, times_ms = demo_frame(), []
    for _ in range(RUNS):
        begin_s = time.perf_counter()
        people = len(model.detect(rgb))
        times_ms.append(1000 * (time.perf_counter() - begin_s))
    return people, statistics.median(times_ms)


def demo_frame() -> U8:
    """Return a colour image of the shipped recording."""
    messages = (message for _, message in open_recording(DEMO).messages(CompressedRgbdFrame))
    frames = (one for one in messages if isinstance(one, CompressedRgbdFrame))
    return decode_jpeg(next(islice(frames, FRAME, None)).rgb_jpeg)


def write_entry(entry: ModelFile, file: Path) -> None:
    """Copy a file to the user's models and write its entry; ModelError if that fails."""
    folder = own_folder()
    manifest = folder / MANIFEST.name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if file.resolve() != (folder / entry.file).resolve():
            shutil.copyfile(file, folder / entry.file)
        own = load_manifest(manifest) if manifest.is_file() else {}
        write_manifest(manifest, own | {entry.name: entry})
    except OSError as error:
        raise ModelError(f"folder {folder} cannot be written: {error.strerror}") from error
