"""False people in rendered rooms without people: `python -m benchmarks objects --views NUMBER`."""

from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from benchmarks.lib.marks.curve import HEADER as CURVE_HEADER
from benchmarks.lib.marks.curve import curve_rows
from benchmarks.lib.postures.objects import LIKE_MIN, SHORT_S
from benchmarks.lib.postures.rooms import FRAMES, HEADER, VIEW_S, false_tracks, room_rows
from benchmarks.lib.table import markdown, write

NOTE = (
    f"Confirmed tracks, and tracks whose `object_like` stays below {LIKE_MIN:g}, with exact 95 % "
    "intervals of their rates. A view is one image of another random "
    f"room, camera and light, played for {VIEW_S:g} s ({SHORT_S:g} s with mannequins, robots) with "
    f"{FRAMES} frames of noise; a robot sees fewer places in an hour. All rooms have doors, "
    "windows and posters. Not in the lab: coats, statues."
)


CURVE_NOTE = """## By the minimum score of detections

Annotated people in the test split of real_variations.md, all augmentations together (MoveNet,
`detector.score_min`), and tracks in the furnished rooms above."""


def write_rooms(shared: Path, views: int, jobs: int, dry: bool) -> None:
    """Play the rooms and write their tables."""
    with ProcessPoolExecutor(jobs) as pool:
        table = markdown(HEADER, list(room_rows(views, pool)))
        curve = markdown(CURVE_HEADER, list(curve_rows(shared, partial(false_tracks, views, pool))))
    text, command = [table, CURVE_NOTE, curve], f"benchmarks objects --views {views}"
    write(__file__, "False people in rooms", NOTE, *text, dry=dry, command=command)
