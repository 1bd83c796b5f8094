"""Files of a ROS bag, possibly of a killed recorder."""

from pathlib import Path

from common.io.mcap_index import read_profile
from people4d.errors import SourceError

ROS1_PROFILE = "ros1"
WAL_HEADER_BYTES = 32  # [bytes] size of a write-ahead log without messages
JOURNAL_MAGIC = (
    b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7"  # start of a journal with changes that are not rolled back
)
REPAIR = "import sqlite3; sqlite3.connect('{}').execute('PRAGMA wal_checkpoint(TRUNCATE)')"


def remedy_of(path: Path) -> str:
    """Return a remedy for an incomplete file of a recorder or tool, empty for other files."""
    unpack = f"Run `zstd -d {path}` and give the file that it writes."
    remedies = {
        ".active": "Its recorder was killed: run `rosbag reindex` and name it .bag.",
        ".zstd": unpack,
        ".zst": unpack,
        ".db3-wal": "Give the .db3 file next to it.",
    }
    return remedies.get(path.suffix, "")


def is_bag(path: Path) -> bool:
    """Check for a ROS bag: a .bag, .db3 or .mcap file, or a folder of these; or SourceError."""
    if path.is_dir():
        known = (path / "metadata.yaml").exists() or any(path.glob("*.db3"))
        return known or any(is_bag(file) for file in sorted(path.glob("*.mcap")))
    if path.suffix == ".mcap":
        return read_profile(path).startswith("ros")
    return path.suffix in (".bag", ".db3")


def bag_path(path: Path) -> Path:
    """Return the path to open: of a folder without metadata.yaml, its only file.

    SourceError if there are several files, or the file is an MCAP of ROS 1.
    """
    if path.is_dir() and not (path / "metadata.yaml").exists():
        files = sorted([*path.glob("*.db3"), *path.glob("*.mcap")])
        if len(files) != 1:
            names = ", ".join(file.name for file in files[:8]) or "no .db3 and no .mcap"
            raise SourceError(
                f"bag {path} has no metadata.yaml (a recorder that is killed writes none)",
                f"Run `ros2 bag reindex {path}`, or give one of its files: {names}.",
            )
        path = files[0]
    if path.suffix == ".mcap" and path.is_file() and _is_of_ros1(path):
        raise SourceError(
            f"bag {path} is an MCAP file of ROS 1, which is not read",
            "Give the .bag that it was made from.",
        )
    return path


def _is_of_ros1(path: Path) -> bool:
    try:
        return read_profile(path) == ROS1_PROFILE
    except SourceError:  # the reader reports the error
        return False


def check_written(database: Path) -> None:
    """Check that a SQLite file has no messages in a log next to it.

    SourceError if a log next to the file has messages, since its recorder was killed.
    """
    wal, journal = (database.with_name(f"{database.name}{end}") for end in ("-wal", "-journal"))
    if wal.is_file() and wal.stat().st_size > WAL_HEADER_BYTES:
        left = wal.name
    elif journal.is_file() and _starts_with(journal, JOURNAL_MAGIC):
        left = journal.name
    else:
        return
    raise SourceError(
        f"bag {database}: {left} holds messages that are not in it: its recorder was killed, or "
        "is still recording",
        f'If nothing records, run: python3 -c "{REPAIR.format(database)}"',
    )


def _starts_with(path: Path, magic: bytes) -> bool:
    with path.open("rb") as file:
        return file.read(len(magic)) == magic
