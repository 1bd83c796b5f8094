"""Filmstrips of ID switches: images of the person, with the tracks and detections near by."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from common.drawing.palette import FAINT
from common.drawing.people import CameraView, annotate
from common.geometry.transforms import apply, invert, project
from common.io.images import decode_jpeg, encode_jpeg
from common.io.recording import open_recording
from common.metrics import EvaluationFrame, IdSwitch
from evaluation.run.run import EvaluationRun, RunOutput
from people4d.errors import DecodeError
from people4d.messages import F64, U8, CompressedRgbdFrame, Detections, RgbdFrame, Tracks
from services.camera.source import SourceFrame
from services.camera.sources import kind_of, open_source

MAX_FILMSTRIPS = 5  # of one run
AROUND = 6  # frames before the last and after the first match that are shown, too
NEAR_M = 1.5  # tracks and detections farther from the person are not listed
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
        _, data = cv2.imencode(".png", bgr)
        return data.tobytes()


def filmstrips_of(run: EvaluationRun, output: RunOutput) -> tuple[Filmstrip, ...]:
    """Return filmstrips of the first ID switches of a run."""
    switches = output.matching.id_switches[:MAX_FILMSTRIPS]
    if not switches:
        return ()
    chosen = {
        switch: _frames_around(switch, len(output.matching.frame_matches)) for switch in switches
    }
    frames = output.matching.sequence.frames
    stamps = {frames[row].stamp_ns for rows in chosen.values() for row in rows}
    images = images_at(run, stamps)
    detections = {m.stamp_ns: m for m in output.detections if m.stamp_ns in stamps}
    return tuple(
        Filmstrip(
            run.method.name,
            run.recording.name,
            _sentence(switch, output),
            tuple(_cell(switch, row, output, images, detections) for row in rows),
        )
        for switch, rows in chosen.items()
    )


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
        if message.stamp_ns in stamps_ns:
            rgb = _rgb(message)
            if rgb is not None:
                found[message.stamp_ns] = rgb
    return found


def _rgb(message: object) -> U8 | None:
    if isinstance(message, RgbdFrame):
        return message.rgb
    if not isinstance(message, CompressedRgbdFrame):
        return None
    try:
        return decode_jpeg(message.rgb_jpeg)
    except DecodeError:
        return None


def _frames_around(switch: IdSwitch, count: int) -> list[int]:
    """Return the frames that are shown: before, the last match, between, the first match, after."""
    last, first = switch.last_frame, switch.frame
    rows = {last - AROUND, last, (last + first) // 2, first - 1, first, first + AROUND}
    return sorted(row for row in rows if 0 <= row < count)


def _sentence(switch: IdSwitch, output: RunOutput) -> str:
    sequence = output.matching.sequence
    last_s, at_s = sequence.stamps_s[[switch.last_frame, switch.frame]]
    between = sequence.frames[switch.last_frame + 1 : switch.frame]
    text = (
        f"Person {switch.person} was ID {switch.before} until {last_s:.2f} s and is "
        f"ID {switch.after} from {at_s:.2f} s on."
    )
    if between:
        hidden = sum(_is_ignored(frame, switch) for frame in between)
        detected = sum(_distance_m(frame, switch, output) <= 0.5 for frame in between)
        text += (
            f" Of the {len(between)} frames between, the person was occluded or out of view in "
            f"{hidden} and detected in {detected}."
        )
    return f"{text} {_previous_track(switch, output)}"


def _previous_track(switch: IdSwitch, output: RunOutput) -> str:
    """Describe the further life of the track that the person had before."""
    step, frame = (
        output.matching.frame_matches[switch.frame],
        output.matching.sequence.frames[switch.frame],
    )
    ids = frame.hypotheses.ids
    if switch.before not in ids:
        return f"ID {switch.before} is no longer reported."
    column = ids.index(switch.before)
    owners = step.persons[step.rows[step.columns == column]]
    if len(owners):
        return f"ID {switch.before} now matches person {output.matching.persons[owners[0]]}."
    return f"ID {switch.before} is still reported, but matches no person."


def _is_ignored(frame: EvaluationFrame, switch: IdSwitch) -> bool:
    truth = frame.truth
    return switch.person not in truth.ids or not truth.required[truth.ids.index(switch.person)]


def _distance_m(frame: EvaluationFrame, switch: IdSwitch, output: RunOutput) -> float:
    """Return how far the nearest detection is from a person, infinite if there is none."""
    found = next((m for m in output.detections if m.stamp_ns == frame.stamp_ns), None)
    position_m, pose = _position(frame, switch), frame.map_from_camera
    if found is None or position_m is None or pose is None:
        return np.inf
    positions = [p.position_m for p in found.detections if p.position_m is not None]
    return min(
        (_apart_m(apply(pose, position), position_m) for position in positions), default=np.inf
    )


def _position(frame: EvaluationFrame, switch: IdSwitch) -> F64 | None:
    truth = frame.truth
    if truth.positions_m is None or switch.person not in truth.ids:
        return None
    position_m: F64 = truth.positions_m[truth.ids.index(switch.person)]
    return position_m


def _cell(
    switch: IdSwitch,
    row: int,
    output: RunOutput,
    images: Mapping[int, U8],
    detections: Mapping[int, Detections],
) -> FilmstripImage:
    sequence = output.matching.sequence
    frame = sequence.frames[row]
    position_m, tracks = _position(frame, switch), output.tracks.get(frame.stamp_ns)
    title = f"{sequence.stamps_s[row]:.2f} s"
    if row == switch.last_frame:
        title += f", last as {switch.before}"
    elif row == switch.frame:
        title += f", first as {switch.after}"
    if position_m is None:
        return FilmstripImage(b"", title, ("not captured",))
    found = detections.get(frame.stamp_ns)
    size = (output.info.height, output.info.width, 3)
    rgb = images.get(frame.stamp_ns, np.full(size, FAINT, np.uint8))
    jpeg = b""
    if frame.map_from_camera is not None:
        view = CameraView(output.info, invert(frame.map_from_camera))
        jpeg = _cut(annotate(rgb, found, tracks, view), view, position_m)
    near = _tracks_near(tracks, position_m) if tracks else []
    hidden = ["occluded or out of view"] if _is_ignored(frame, switch) else []
    return FilmstripImage(
        jpeg,
        title,
        (*hidden, *(near or ["no track near"]), *_detections_near(frame, found, position_m)),
    )


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
                identity = f"{track.identity}{shown}"
                lines.append(": ".join(filter(None, (identity, track.identity_reason))))
    return lines


def _detections_near(
    frame: EvaluationFrame, found: Detections | None, position_m: F64
) -> list[str]:
    if found is None or frame.map_from_camera is None:
        return []
    near = []
    for person in found.detections:
        if person.position_m is not None:
            apart_m = _apart_m(apply(frame.map_from_camera, person.position_m), position_m)
            near.append((apart_m, person.score))
    lines = [f"detection {score:.2f}: {d:.2f} m" for d, score in sorted(near) if d <= NEAR_M]
    return lines or ["no detection near"]


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
    square = np.full((2 * half, 2 * half, 3), FAINT, np.uint8)
    rows, columns = (
        (max(top, 0), min(top + 2 * half, height)),
        (max(left, 0), min(left + 2 * half, width)),
    )
    square[rows[0] - top : rows[1] - top, columns[0] - left : columns[1] - left] = image[
        slice(*rows), slice(*columns)
    ]
    interpolation = cv2.INTER_AREA if 2 * half > SIDE_PX else cv2.INTER_CUBIC
    small = cv2.resize(square, (SIDE_PX, SIDE_PX), interpolation=interpolation)
    return encode_jpeg(np.asarray(small, np.uint8), QUALITY)
