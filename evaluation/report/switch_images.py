"""Images of ID switches: the person with tracks and detections, before and after the switch."""

from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass

import cv2
import numpy as np

from common.drawing.people import CameraView, annotate
from common.drawing.strokes import FAINT
from common.geometry.transforms import apply, invert, project
from common.io.images import decode_jpeg
from common.io.recording import open_recording
from common.metrics.frame_scores import IdSwitch
from evaluation.run.run import EvaluationRun, RunOutput
from people4d.errors import DecodeError
from people4d.messages import U8, CompressedRgbdFrame, RgbdFrame
from services.camera.source import SourceFrame
from services.camera.sources import kind_of, open_source

SWITCHES_MAX = 5  # maximum number of switches of a run with an image
AROUND = 6  # number of frames before the last and after the first match
BODY_M = 2.3  # [m] side of the square around the person
SIDE_PX = 210  # [px] side of the image of the square
NEAR_M = 0.2  # [m] minimum depth of a shown person


@dataclass(frozen=True)
class SwitchImage:
    """Image of one ID switch."""

    method: str
    recording: str
    sentence: str  # description of the switch
    png: bytes  # frames before, at and after the switch, side by side


def switch_images(run: EvaluationRun, output: RunOutput) -> tuple[SwitchImage, ...]:
    """Return images of the first ID switches of a run."""
    frames = output.matching.sequence.frames
    rows_of = {s: _rows(s, len(frames)) for s in output.matching.id_switches[:SWITCHES_MAX]}
    if not rows_of:
        return ()
    images = images_at(run, {frames[row].stamp_ns for rows in rows_of.values() for row in rows})
    found = []
    for switch, rows in rows_of.items():
        squares = np.concatenate([_square(switch, row, output, images) for row in rows], axis=1)
        png = cv2.imencode(".png", cv2.cvtColor(squares, cv2.COLOR_RGB2BGR))[1].tobytes()
        sentence = _sentence(switch, rows, output)
        found.append(SwitchImage(run.method.name, run.recording.name, sentence, png))
    return tuple(found)


def images_at(run: EvaluationRun, stamps_ns: Collection[int]) -> dict[int, U8]:
    """Return the colour images of some stamps, if the recording has them."""
    path = run.recording.path
    if kind_of(str(path)) != "recording":
        camera = run.method.camera
        source = open_source(str(path), camera.options)
        captures = (item for item in source if isinstance(item, SourceFrame))
        return {c.stamp_ns: c.rgb for c in captures if c.stamp_ns in stamps_ns}
    found: dict[int, U8] = {}
    for _, message in open_recording(path).messages(CompressedRgbdFrame, RgbdFrame):
        if message.stamp_ns not in stamps_ns:
            continue
        if isinstance(message, RgbdFrame):
            found[message.stamp_ns] = message.rgb
        elif isinstance(message, CompressedRgbdFrame):
            with suppress(DecodeError):
                found[message.stamp_ns] = decode_jpeg(message.rgb_jpeg)
    return found


def _rows(switch: IdSwitch, count: int) -> list[int]:
    """Return the indices of the shown frames."""
    last, first = switch.last_frame, switch.frame
    rows = {last - AROUND, last, (last + first) // 2, first - 1, first, first + AROUND}
    return sorted(row for row in rows if 0 <= row < count)


def _sentence(switch: IdSwitch, rows: list[int], output: RunOutput) -> str:
    stamps_s = output.matching.sequence.stamps_s
    shown = ", ".join(f"{stamps_s[row]:.2f}" for row in rows)
    return (
        f"Person {switch.person} was ID {switch.before} until {stamps_s[switch.last_frame]:.2f} s "
        f"and is ID {switch.after} from {stamps_s[switch.frame]:.2f} s on. Shown: {shown} s."
    )


def _square(switch: IdSwitch, row: int, output: RunOutput, images: Mapping[int, U8]) -> U8:
    """Return the annotated square around the person in one frame; blank if they are not in it."""
    frame, info = output.matching.sequence.frames[row], output.info
    blank = np.full((SIDE_PX, SIDE_PX, 3), FAINT, np.uint8)
    truth, pose = frame.truth, frame.map_from_camera
    if truth.positions_m is None or switch.person not in truth.ids or pose is None:
        return blank
    view = CameraView(info, invert(pose))
    point = apply(view.optical_from_map, truth.positions_m[truth.ids.index(switch.person)])
    if point[2] < NEAR_M:
        return blank
    rgb = images.get(frame.stamp_ns, np.full((info.height, info.width, 3), FAINT, np.uint8))
    detections = {message.stamp_ns: message for message in output.detections}
    tracks = output.tracks.get(frame.stamp_ns)
    annotated = annotate(rgb, detections.get(frame.stamp_ns), tracks, view)
    side_px = round(float(BODY_M * info.fy / point[2]))
    u, v = project(point, info)[0].tolist()
    square = cv2.getRectSubPix(annotated, (side_px, side_px), (u, v))
    return np.asarray(cv2.resize(square, (SIDE_PX, SIDE_PX)), np.uint8)
