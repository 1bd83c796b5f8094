"""False people in rendered rooms without people: `python -m benchmarks objects --views NUMBER`."""

from concurrent.futures import ProcessPoolExecutor

from benchmarks.lib.postures.objects import LIKE_MIN, SHORT_S
from benchmarks.lib.postures.rooms import FRAMES, HEADER, VIEW_S, room_rows
from benchmarks.lib.table import markdown, write

NOTE = (
    f"Confirmed tracks, and tracks whose `object_like` stays below {LIKE_MIN:g}, with exact 95 % "
    "intervals of their rates. A view is one image of another random "
    f"room, camera and light, played for {VIEW_S:g} s ({SHORT_S:g} s with mannequins, robots) with "
    f"{FRAMES} frames of noise; a robot sees fewer places in an hour. All rooms have doors, "
    "windows and posters. Not in the lab: coats, statues."
)


def write_rooms(views: int, jobs: int, dry: bool) -> None:
    """Play the rooms and write their table."""
    with ProcessPoolExecutor(jobs) as pool:
        found = list(room_rows(views, pool))
    table, command = markdown(HEADER, found), f"benchmarks objects --views {views}"
    write(__file__, "False people in rooms", NOTE, table, dry=dry, command=command)
