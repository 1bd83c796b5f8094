"""Objects that are detected as people, and people, by their `object_like`.

With `--views` also false people in rendered rooms (rooms.md), which takes about an hour.
"""

from benchmarks.lib import options
from benchmarks.lib.postures.images import image_rows
from benchmarks.lib.postures.objects import HEADER, LIKE_MIN, rows
from benchmarks.lib.table import markdown, write
from benchmarks.rooms import write_rooms

SEEDS = range(3000, 3001)  # never seen while constants were chosen
NOTE = (
    f"Figures whose `object_like` reaches {LIKE_MIN:g}, and the median time from the first frame "
    "until then. One image: repeated with sensor noise, a figure that never moves; posters and "
    "screens have the depth of a plane. Simulated: joints with the errors of a detector. Chosen "
    "with the robot: the limit of stillness; with felix, filinha and other posters: the limit of "
    "flatness."
)


def main() -> None:
    """Play all figures and write the table."""
    parser = options.parser(__doc__, "shared", "cache", "jobs", "dry")
    parser.add_argument("--views", type=int, default=0, help="rooms of each kind; 60 in rooms.md")
    asked = parser.parse_args()
    found = [*image_rows(asked.shared, asked.cache), *rows(SEEDS)]
    write(__file__, "Objects detected as people", NOTE, markdown(HEADER, found), dry=asked.dry)
    if asked.views:
        write_rooms(asked.shared, asked.views, asked.jobs, asked.dry)
