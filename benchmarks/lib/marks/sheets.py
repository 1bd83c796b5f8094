"""Contact sheets of images with marks and tracks, for the eye; they show real people."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from common.drawing.strokes import GREY, INK, WHITE, colour_of, put_label
from common.drawing.tiles import Tile, grid, shrink
from evaluation.recordings.mark_scores import MarkOutcome, MarkScores, TrackedPerson
from people4d.messages import U8
from services.camera.source import SourceFrame

STEP = 3  # frames from tile to tile
COLUMNS = 5
WIDTH_PX = 360
RIGHT, WRONG = (40, 200, 90), (235, 60, 60)


def write_sheet(
    path: Path,
    images: Sequence[SourceFrame],
    tracks: Mapping[int, Sequence[TrackedPerson]],
    scores: MarkScores,
) -> None:
    """Draw the marked frames of a recording.

    Marks are green with the right identity, red with another one and white without a track; boxes
    have the colour of their identity, thin where predicted.
    """
    frames = sorted({outcome.frame for outcome in scores.outcomes})[::STEP]
    tiles = []
    for frame in frames:
        image = images[frame].rgb.copy()
        for track in tracks.get(frame, ()):
            _draw_track(image, track)
        for outcome in scores.outcomes:
            if outcome.frame == frame:
                _draw_mark(image, outcome)
        tiles.append(Tile(shrink(image, WIDTH_PX), str(frame)))
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), grid(tiles, COLUMNS)[:, :, ::-1])


def _draw_track(image: U8, track: TrackedPerson) -> None:
    left, top, right, bottom = np.rint(track.box_xyxy_px).astype(int).tolist()
    colour, thickness = colour_of(track.id), 1 if track.predicted else 3
    cv2.rectangle(image, (left, top), (right, bottom), colour, thickness)
    put_label(image, str(track.id), (left, top + 20), 16, GREY if track.predicted else colour)


def _draw_mark(image: U8, outcome: MarkOutcome) -> None:
    mark = outcome.truth.mark
    colour = WHITE if outcome.track is None else RIGHT if outcome.is_owner else WRONG
    at = round(mark.u_px), round(mark.v_px)
    cv2.circle(image, at, 9, INK, cv2.FILLED)
    cv2.circle(image, at, 7, colour, cv2.FILLED)
    put_label(image, mark.person, (at[0] + 8, at[1] + 8), 14, colour)
