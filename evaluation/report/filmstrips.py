"""Filmstrips of ID switches: images of the person, with the tracks and detections near by."""

from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass

import cv2
import numpy as np

from common.drawing.people import CameraView, annotate
from common.drawing.strokes import FAINT
from common.geometry.transforms import apply, invert, project
from common.io.images import decode_jpeg, encode_jpeg
from common.io.recording import open_recording
from common.metrics.frame_scores import IdSwitch
from common.metrics.record import EvaluationFrame
from evaluation.run.run import EvaluationRun, RunOutput
from people4d.errors import DecodeError
from people4d.messages import F64, U8, CompressedRgbdFrame, Detections, RgbdFrame, Tracks
from services.camera.source import SourceFrame
from services.camera.sources import kind_of, open_source

MAX_FILMSTRIPS = 5  # of one run
AROUND = 6  # frames before the last and after the first match that are shown, too
NEAR_M = 1.5  # tracks and detections farther from the person are not listed
DETECTED_M = 0.5  # a detection so near is of the person
BODY_M = 2.3  # side of the square that is cut out
SIDE_PX = 210
QUALITY = 82


@dataclass(frozen=True)
class FilmstripImage:
    """One frame."""

    jpeg: bytes  # image of the person and others near by; empty if behind the camera
    title: str  # time
    lines: tuple[str, ...]  # tracks and detections near by


@dataclass(frozen=True)
class Filmstrip:
    """One ID switch."""

    method: str
    recording: str
    sentence: str  # description of the switch
    images: tuple[FilmstripImage, ...]  # frames, in order of time

    def png(self) -> bytes:
        """Return the images side by side."""
        blank = np.full((SIDE_PX, SIDE_PX, 3), FAINT, np.uint8)
        images = [decode_jpeg(cell.jpeg) if cell.jpeg else blank for cell in self.images]
        bgr = cv2.cvtColor(np.concatenate(images, axis=1), cv2.COLOR_RGB2BGR)
        return cv2.imencode(".png", bgr)[1].tobytes()


def filmstrips_of(run: EvaluationRun, output: RunOutput) -> tuple[Filmstrip, ...]:
    """Return filmstrips of the first ID switches of a run."""
    frames = output.matching.sequence.frames
    rows_of = {s: _rows(s, len(frames)) for s in output.matching.id_switches[:MAX_FILMSTRIPS]}
    if not rows_of:
        return ()
    images = images_at(run, {frames[row].stamp_ns for rows in rows_of.values() for row in rows})
    detections = {message.stamp_ns: message for message in output.detections}
    filmstrips = []
    for switch, rows in rows_of.items():
        sentence = _sentence(switch, output, detections)
        cells = tuple(_cell(switch, row, output, images, detections) for row in rows)
        filmstrips.append(Filmstrip(run.method.name, run.recording.name, sentence, cells))
    return tuple(filmstrips)


def images_at(run: EvaluationRun, stamps_ns: Collection[int]) -> dict[int, U8]:
    """Return the colour images of some stamps, as far as the recording has them."""
    path = run.recording.path
    if kind_of(str(path)) != "recording":
        camera = run.method.camera
        source = open_source(str(path), camera.kind, camera.options)
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
    """Return the frames that are shown: before, the last match, between, the first match, after."""
    last, first = switch.last_frame, switch.frame
    rows = {last - AROUND, last, (last + first) // 2, first - 1, first, first + AROUND}
    return sorted(row for row in rows if 0 <= row < count)


def _sentence(switch: IdSwitch, output: RunOutput, detections: Mapping[int, Detections]) -> str:
    sequence = output.matching.sequence
    last_s, at_s = sequence.stamps_s[[switch.last_frame, switch.frame]]
    between = sequence.frames[switch.last_frame + 1 : switch.frame]
    text = (
        f"Person {switch.person} was ID {switch.before} until {last_s:.2f} s and is "
        f"ID {switch.after} from {at_s:.2f} s on."
    )
    if between:
        hidden = sum(_is_ignored(frame, switch) for frame in between)
        near = (_detections_near(frame, switch, detections, DETECTED_M) for frame in between)
        text += (
            f" Of the {len(between)} frames between, the person was occluded or out of view in "
            f"{hidden} and detected in {sum(map(bool, near))}."
        )
    return f"{text} {_previous_track(switch, output)}"


def _previous_track(switch: IdSwitch, output: RunOutput) -> str:
    """Describe the further life of the track that the person had before."""
    matches = output.matching.frame_matches[switch.frame]
    ids = output.matching.sequence.frames[switch.frame].hypotheses.ids
    if switch.before not in ids:
        return f"ID {switch.before} is no longer reported."
    owners = matches.persons[matches.rows[matches.columns == ids.index(switch.before)]]
    if len(owners):
        return f"ID {switch.before} now matches person {output.matching.persons[owners[0]]}."
    return f"ID {switch.before} is still reported, but matches no person."


def _is_ignored(frame: EvaluationFrame, switch: IdSwitch) -> bool:
    truth = frame.truth
    return switch.person not in truth.ids or not truth.required[truth.ids.index(switch.person)]


def _position(frame: EvaluationFrame, switch: IdSwitch) -> F64 | None:
    truth = frame.truth
    if truth.positions_m is None or switch.person not in truth.ids:
        return None
    return np.asarray(truth.positions_m[truth.ids.index(switch.person)])


def _cell(
    switch: IdSwitch,
    row: int,
    output: RunOutput,
    images: Mapping[int, U8],
    detections: Mapping[int, Detections],
) -> FilmstripImage:
    frame, info = output.matching.sequence.frames[row], output.info
    position_m, tracks = _position(frame, switch), output.tracks.get(frame.stamp_ns)
    title = f"{output.matching.sequence.stamps_s[row]:.2f} s"
    if row == switch.last_frame:
        title += f", last as {switch.before}"
    elif row == switch.frame:
        title += f", first as {switch.after}"
    if position_m is None:
        return FilmstripImage(b"", title, ("not captured",))
    lines = ["occluded or out of view"] if _is_ignored(frame, switch) else []
    lines += (_tracks_near(tracks, position_m) if tracks else []) or ["no track near"]
    found, jpeg = detections.get(frame.stamp_ns), b""
    if frame.map_from_camera is not None:
        view = CameraView(info, invert(frame.map_from_camera))
        blank = np.full((info.height, info.width, 3), FAINT, np.uint8)
        rgb = annotate(images.get(frame.stamp_ns, blank), found, tracks, view)
        jpeg = _cut(rgb, view, position_m)
        if found:
            near = _detections_near(frame, switch, detections, NEAR_M)
            lines += [f"detection {score:.2f}: {apart_m:.2f} m" for apart_m, score in near]
            lines += [] if near else ["no detection near"]
    return FilmstripImage(jpeg, title, tuple(lines))


def _tracks_near(tracks: Tracks, position_m: F64) -> list[str]:
    """Return a line for each track near a position, and one with its identity and the reason."""
    near = sorted((_apart_m(t.position_m, position_m), t.id, t) for t in tracks.tracks)
    lines = []
    for apart_m, _, track in near:
        if apart_m <= NEAR_M:
            lines.append(f"ID {track.id}: {track.state}, {apart_m:.2f} m")
            if track.identity is not None:
                confidence = track.identity_confidence
                shown = "" if confidence is None else f" {confidence:.2f}"
                reason = f": {track.identity_reason}" if track.identity_reason else ""
                lines.append(f"{track.identity}{shown}{reason}")
    return lines


def _detections_near(
    frame: EvaluationFrame, switch: IdSwitch, detections: Mapping[int, Detections], limit_m: float
) -> list[tuple[float, float]]:
    """Return distance and score of the detections up to a distance from the person."""
    found, pose = detections.get(frame.stamp_ns), frame.map_from_camera
    position_m = _position(frame, switch)
    if found is None or pose is None or position_m is None:
        return []
    people = [(one.position_m, one.score) for one in found.detections]
    near = [(_apart_m(apply(pose, p), position_m), s) for p, s in people if p is not None]
    return sorted(one for one in near if one[0] <= limit_m)


def _apart_m(a: F64, b: F64) -> float:
    return float(np.linalg.norm((a - b)[:2]))


def _cut(image: U8, view: CameraView, position_m: F64) -> bytes:
    """Cut a square about a person out of an image, as JPEG; empty if it misses the image."""
    point = apply(view.optical_from_map, position_m)
    if point[2] < 0.2:
        return b""
    u, v = project(point, view.info)[0]
    half = round(float(BODY_M / 2 * view.info.fy / point[2]))
    left, top = round(float(u)) - half, round(float(v)) - half
    height, width = image.shape[:2]
    if left >= width or top >= height or left + 2 * half <= 0 or top + 2 * half <= 0:
        return b""
    shift = np.array([[1.0, 0.0, -left], [0.0, 1.0, -top]])
    nearest, border = cv2.INTER_NEAREST, cv2.BORDER_CONSTANT
    square = cv2.warpAffine(image, shift, (2 * half, 2 * half), None, nearest, border, FAINT)
    interpolation = cv2.INTER_AREA if 2 * half > SIDE_PX else cv2.INTER_CUBIC
    small = cv2.resize(square, (SIDE_PX, SIDE_PX), interpolation=interpolation)
    return encode_jpeg(np.asarray(small, np.uint8), QUALITY)
