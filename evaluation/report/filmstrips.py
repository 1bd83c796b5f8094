"""Each ID switch as a strip of pictures of the person, with what the tracker believed."""

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

MOST = 5  # strips of one trial
AROUND = 6  # frames before the last and after the first match that are shown, too
NEAR_M = 1.5  # tracks and detections farther from the person are not told
BODY_M = 2.3  # side of the square that is cut out
SIDE_PX = 210
QUALITY = 82


@dataclass(frozen=True)
class FilmstripImage:
    """One moment.

    Args:
        jpeg: Picture of the person and who is near; empty if they are not before the camera.
        title: When it was.
        lines: What the tracker believed.
    """

    jpeg: bytes
    title: str
    lines: tuple[str, ...]


@dataclass(frozen=True)
class Filmstrip:
    """One ID switch.

    Args:
        method: Who made it.
        take: Where.
        sentence: What happened, in words.
        cells: Moments, in order of time.
    """

    method: str
    take: str
    sentence: str
    cells: tuple[FilmstripImage, ...]

    def png(self) -> bytes:
        """Return the pictures side by side."""
        blank = np.full((SIDE_PX, SIDE_PX, 3), FAINT, np.uint8)
        pictures = [decode_jpeg(cell.jpeg) if cell.jpeg else blank for cell in self.cells]
        bgr = cv2.cvtColor(np.concatenate(pictures, axis=1), cv2.COLOR_RGB2BGR)
        _, data = cv2.imencode(".png", bgr)
        return data.tobytes()


def filmstrips_of(trial: EvaluationRun, done: RunOutput) -> tuple[Filmstrip, ...]:
    """Return strips of the first ID switches of a run."""
    switches = done.matching.id_switches[:MOST]
    if not switches:
        return ()
    chosen = {switch: _moments(switch, len(done.matching.frame_matches)) for switch in switches}
    frames = done.matching.sequence.frames
    stamps = {frames[row].stamp_ns for rows in chosen.values() for row in rows}
    pictures = pictures_at(trial, stamps)
    detections = {m.stamp_ns: m for m in done.detections if m.stamp_ns in stamps}
    return tuple(
        Filmstrip(
            trial.method.name,
            trial.take.name,
            _sentence(switch, done),
            tuple(_cell(switch, row, done, pictures, detections) for row in rows),
        )
        for switch, rows in chosen.items()
    )


def pictures_at(trial: EvaluationRun, stamps_ns: Collection[int]) -> dict[int, U8]:
    """Return the colour images of some stamps, as far as the recording has them."""
    path = trial.take.path
    if kind_of(str(path)) != "recording":
        camera = trial.method.camera
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


def _moments(switch: IdSwitch, count: int) -> list[int]:
    """Return the frames that are shown: before, the last match, between, the first match, after."""
    last, first = switch.last_frame, switch.frame
    rows = {last - AROUND, last, (last + first) // 2, first - 1, first, first + AROUND}
    return sorted(row for row in rows if 0 <= row < count)


def _sentence(switch: IdSwitch, done: RunOutput) -> str:
    sequence = done.matching.sequence
    last_s, at_s = sequence.stamps_s[[switch.last_frame, switch.frame]]
    between = sequence.frames[switch.last_frame + 1 : switch.frame]
    text = (
        f"Person {switch.person} was ID {switch.before} until {last_s:.2f} s and is "
        f"ID {switch.after} from {at_s:.2f} s on."
    )
    if between:
        hidden = sum(_is_hidden(frame, switch) for frame in between)
        detected = sum(_distance_m(frame, switch, done) <= 0.5 for frame in between)
        text += (
            f" Of the {len(between)} frames between, the person was hidden or out of view in "
            f"{hidden} and detected in {detected}."
        )
    return f"{text} {_whereabouts(switch, done)}"


def _whereabouts(switch: IdSwitch, done: RunOutput) -> str:
    """Tell what became of the track that the person had before."""
    step, frame = (
        done.matching.frame_matches[switch.frame],
        done.matching.sequence.frames[switch.frame],
    )
    ids = frame.hypotheses.ids
    if switch.before not in ids:
        return f"ID {switch.before} is no longer told."
    column = ids.index(switch.before)
    owners = step.persons[step.rows[step.columns == column]]
    if len(owners):
        return f"ID {switch.before} now follows person {done.matching.persons[owners[0]]}."
    return f"ID {switch.before} is still told, but follows nobody."


def _is_hidden(frame: EvaluationFrame, switch: IdSwitch) -> bool:
    truth = frame.truth
    return switch.person not in truth.ids or not truth.required[truth.ids.index(switch.person)]


def _distance_m(frame: EvaluationFrame, switch: IdSwitch, done: RunOutput) -> float:
    """Return how far the nearest detection is from a person, infinite if there is none."""
    found = next((m for m in done.detections if m.stamp_ns == frame.stamp_ns), None)
    place, pose = _place(frame, switch), frame.map_from_camera
    if found is None or place is None or pose is None:
        return np.inf
    positions = [p.position_m for p in found.detections if p.position_m is not None]
    return min((_apart_m(apply(pose, position), place) for position in positions), default=np.inf)


def _place(frame: EvaluationFrame, switch: IdSwitch) -> F64 | None:
    truth = frame.truth
    if truth.positions_m is None or switch.person not in truth.ids:
        return None
    place: F64 = truth.positions_m[truth.ids.index(switch.person)]
    return place


def _cell(
    switch: IdSwitch,
    row: int,
    done: RunOutput,
    pictures: Mapping[int, U8],
    detections: Mapping[int, Detections],
) -> FilmstripImage:
    sequence = done.matching.sequence
    frame = sequence.frames[row]
    place, tracks = _place(frame, switch), done.tracks.get(frame.stamp_ns)
    title = f"{sequence.stamps_s[row]:.2f} s"
    if row == switch.last_frame:
        title += f", last as {switch.before}"
    elif row == switch.frame:
        title += f", first as {switch.after}"
    if place is None:
        return FilmstripImage(b"", title, ("not captured",))
    found = detections.get(frame.stamp_ns)
    size = (done.info.height, done.info.width, 3)
    rgb = pictures.get(frame.stamp_ns, np.full(size, FAINT, np.uint8))
    jpeg = b""
    if frame.map_from_camera is not None:
        view = CameraView(done.info, invert(frame.map_from_camera))
        jpeg = _cut(annotate(rgb, found, tracks, view), view, place)
    told = _told(tracks, place) if tracks else []
    hidden = ["hidden or out of view"] if _is_hidden(frame, switch) else []
    return FilmstripImage(
        jpeg, title, (*hidden, *(told or ["no track near"]), *_found(frame, found, place))
    )


def _told(tracks: Tracks, place: F64) -> list[str]:
    """Return a line for each track near a place, and one with who it was taken for and why."""
    near = sorted((_apart_m(t.position_m, place), t.id, t) for t in tracks.tracks)
    lines = []
    for apart_m, _, track in near:
        if apart_m <= NEAR_M:
            lines.append(f"ID {track.id}: {track.state}, {apart_m:.2f} m")
            if track.identity is not None:
                sure = track.identity_confidence
                known = track.identity if sure is None else f"{track.identity} {sure:.2f}"
                lines.append(": ".join(filter(None, (known, track.identity_reason))))
    return lines


def _found(frame: EvaluationFrame, found: Detections | None, place: F64) -> list[str]:
    if found is None or frame.map_from_camera is None:
        return []
    near = []
    for person in found.detections:
        if person.position_m is not None:
            apart_m = _apart_m(apply(frame.map_from_camera, person.position_m), place)
            near.append((apart_m, person.score))
    lines = [f"detection {score:.2f}: {d:.2f} m" for d, score in sorted(near) if d <= NEAR_M]
    return lines or ["no detection near"]


def _apart_m(a: F64, b: F64) -> float:
    return float(np.linalg.norm((a - b)[:2]))


def _cut(image: U8, view: CameraView, place: F64) -> bytes:
    """Cut a square about a person out of an image, as JPEG; empty if it misses the image."""
    point = apply(view.optical_from_map, place)
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
    how = cv2.INTER_AREA if 2 * half > SIDE_PX else cv2.INTER_CUBIC
    small = cv2.resize(square, (SIDE_PX, SIDE_PX), interpolation=how)
    return encode_jpeg(np.asarray(small, np.uint8), QUALITY)
