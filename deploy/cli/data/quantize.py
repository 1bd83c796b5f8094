"""Command `people4d models quantize`."""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from common.extras import need
from common.inference.session import Array
from common.io.weights import locate
from deploy.cli.terminal import console, plain_table, progress
from people4d.errors import ConfigError, ModelError

# Most modules are imported on use: the lab and compiled code take a second to load.
HARM_IMAGES = 6  # number of images for measuring the loss of accuracy by layer


def quantize(
    model: Annotated[str, typer.Argument(help="Name in people4d models, or an .onnx file.")],
    out: Annotated[
        Path | None, typer.Option(help="File to write; default: MODEL-int8.onnx, here.")
    ] = None,
    images: Annotated[
        Path | None, typer.Option(help="Folder of calibration images, in addition to lab images.")
    ] = None,
) -> None:
    """Quantize a model to int8; layers that lose accuracy on lab frames stay float32."""
    need("quantisation", "quantize")
    from common.inference.onnx import OnnxSession  # noqa: PLC0415
    from evaluation.quantization.accuracy import AccuracyLoss, compare, detect  # noqa: PLC0415
    from evaluation.quantization.control import candidates, harm  # noqa: PLC0415
    from evaluation.quantization.images import (  # noqa: PLC0415
        CALIBRATION,
        ORIENTATION,
        bodies_of,
        images_of,
        inputs,
    )
    from evaluation.quantization.quantizer import Quantizer  # noqa: PLC0415
    from evaluation.recordings.rendered import HELD_OUT, render  # noqa: PLC0415
    from services.detector.config import DetectorConfig  # noqa: PLC0415
    from services.detector.models.registry import recognise  # noqa: PLC0415

    path, entry = locate(model)
    reference = OnnxSession(path)
    kind = entry.kind if entry else recognise(reference, DetectorConfig(), str(path))
    if images and kind == ORIENTATION:
        raise ConfigError("orientation networks need depth", "Leave out --images.")
    own = list(images_of(images)) if images else []
    out = out or Path(f"{path.stem}-int8.onnx")
    with progress() as report, TemporaryDirectory() as folder:
        drawn, count = [], sum(len(frames) for _, _, frames in (*CALIBRATION, *HELD_OUT))
        for number, rendered in enumerate(render((*CALIBRATION, *HELD_OUT)), 1):
            drawn.append(rendered)
            report("frames of the lab", number / count)
        split = sum(len(frames) for _, _, frames in CALIBRATION)
        if kind == ORIENTATION:
            calibration: Sequence[Array] = [bodies_of(one) for one in drawn[:split] if one.people]
        else:
            calibration = inputs(reference, kind, [*(one.frame.rgb for one in drawn[:split]), *own])
        frames = drawn[split:]
        quantizer = Quantizer(path, calibration, Path(folder))
        expected = detect(path, kind, frames)

        def score(file: Path) -> AccuracyLoss:
            return compare(frames, expected, detect(file, kind, frames))

        def order() -> list[str]:
            few = calibration[:: max(len(calibration) // HARM_IMAGES, 1)]
            scratch = Path(folder) / "candidate.onnx"
            return [
                *harm(
                    *(quantizer, reference, few, scratch),
                    lambda done, of: report("harm of each layer", done / of),
                )
            ]

        done = list(candidates(quantizer, out, score, order))
    table = plain_table(">layers in float", ">recall", ">position", ">yaw", "holds")
    for candidate in done:
        loss = candidate.loss
        table.add_row(
            str(len(quantizer.ends()) + len(candidate.floats)),
            f"{-100 * loss.recall:+.1f} %",
            f"{1000 * loss.position_m:+.1f} mm",
            f"{loss.yaw_deg:+.2f} deg",
            "yes" if loss.acceptable else "no",
        )
    console.print(table)
    if not done[-1].loss.acceptable:
        out.unlink()
        raise ModelError(f"{model} loses too much even with all layers in float; nothing written")
    if kind != ORIENTATION:
        scale = done[-1].loss.score_scale
        console.print(
            f"Scores are {scale:.2f} times those in float: set score_scale = {scale:.2f}."
        )
    of = len(quantizer.convolutions)
    console.print(f"{out}: {out.stat().st_size / 1e6:.1f} MB, {of} layers.", markup=False)
