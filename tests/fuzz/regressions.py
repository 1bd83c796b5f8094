"""Findings of fuzzing, minimised: each input once raised an error that it must not."""

import dataclasses
import re
import sqlite3
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from common.io.images import encode_png16
from common.ros2 import types
from common.transport.clock import TimeReply
from deploy import compose
from people4d.codec import encode
from services.events.journal import Journal
from tests.camera.ros.bags import Ros, depth_mm, frames
from tests.contract.examples import BY_NAME
from tests.fuzz.state import COMPOSE


@dataclass(frozen=True)
class Regression:
    """One finding.

    Args:
        name: Target, see `tests.fuzz.targets`.
        story: What happened.
        make: Makes the input; gets a folder.
    """

    name: str
    story: str
    make: Callable[[Path], bytes]


def _long_heading(_: Path) -> bytes:
    heading, long = np.array([0.6, 0.0, -0.8]), np.array([1e255, 0.0, -0.8])
    return encode(BY_NAME["Detections"]).replace(heading.tobytes(), long.tobytes())


MATLAB = (
    b"\x04"  # of the kinds of calibration
    + b"MATLAB 5.0".ljust(124)
    + b"\0\1IM"
    + bytes.fromhex(
        "0e000000380100000600000008000000020000000000000005000000080000000100000001000000"
        "01000000070000005247425f63616d00050004000900000001000000120000004b00000000000000"
        "0044697374436f6566000000000000000e0000007800000006000000080000000600000000000000"
        "0500000008000000030000000300000001000000000000000e000000580000000600000008000000"
        "06000000000000000500000008000000050004000900000001000000120000004b00000000000000"
        "0044697374436f6500000000000000000000000000000000000000000000f03f0e00000058000000"
    )
)


def _flipped_mat(_: Path) -> bytes:
    """A structure with names of fields in its matrix instead of numbers."""
    return MATLAB


def _wrong_size(folder: Path) -> bytes:
    np.savez(folder / "a.npz", t=np.zeros(1))
    data = (folder / "a.npz").read_bytes()
    at = data.rindex(b"PK\x01\x02") + 20  # bytes that are packed, in the directory
    return data[:at] + b"\xfe\xff\xff\x7f" + data[at + 4 :]


def _broken_journal(folder: Path) -> bytes:
    """A journal whose only message is a number."""
    journal = Journal(folder / "events.sqlite", 100)
    journal.append([BY_NAME["Event"]])  # type: ignore[list-item]
    journal.close()
    with closing(sqlite3.connect(folder / "events.sqlite")) as database, database:
        database.execute("UPDATE events SET message = 5")
    return (folder / "events.sqlite").read_bytes()


def _many_replicas(_: Path) -> bytes:
    first, *_rest = compose.read(COMPOSE, {})
    return msgspec.json.encode([dataclasses.replace(first, replicas=2 * 10**16)])


def _odd_frame(_: Path) -> bytes:
    header = {"stamp": {"sec": 5}, "frame_id": "m\x7f"}
    pose = types.encode("geometry_msgs/msg/PoseStamped", {"header": header})
    return b"\1" + len(pose).to_bytes(2, "little") + pose


def _changed(statement: str) -> Callable[[Path], bytes]:
    """Return a function that makes a bag and changes its database."""

    def make(folder: Path) -> bytes:
        path = Ros(2).write(folder / "bag", frames(Ros(2), 1)) / "bag.db3"
        with sqlite3.connect(path) as database:
            database.execute(statement)
        return path.read_bytes()

    return make


REGRESSIONS: Sequence[Regression] = (
    Regression(
        "message Detections",
        "a heading of length 1e255 overflowed with a warning instead of being refused",
        _long_heading,
    ),
    Regression(
        "PNG depth",
        "of 77 bytes, whose header claims 800 MB of pixels: OpenCV allocated as much",
        lambda _: re.sub(
            rb"....IDAT", b"\x30\0\0\0IDAT", encode_png16(depth_mm()), flags=re.DOTALL
        ),
    ),
    Regression(
        "calibration",
        "a damaged MATLAB file ended the process (in SciPy, which now reads none of them)",
        _flipped_mat,
    ),
    Regression(
        "folder with gt.npz",
        "an array with a packed size of 2 GiB in its header allocated that much memory",
        _wrong_size,
    ),
    Regression(
        "ROS 2 bag (SQLite)",
        "a type stored as bytes instead of text raised TypeError",
        _changed("UPDATE topics SET type = x'00'"),
    ),
    Regression(
        "ROS 2 bag (SQLite)",
        "a time stored as text was read as a stamp",
        _changed("UPDATE messages SET timestamp = 'soon'"),
    ),
    Regression(
        "reply of a clock",
        "an identity that is not UTF-8 raised UnicodeDecodeError in the thread of the reply",
        lambda _: msgspec.msgpack.encode(TimeReply("name", 0, 0)).replace(b"name", b"\xff" * 4),
    ),
    Regression(
        "journal of events",
        "a damaged file, or a number in place of a message, ended the service with a traceback",
        _broken_journal,
    ),
    Regression(
        "zones of a page",
        "a number of more than 64 bits raised OverflowError, answered by an error of the server",
        lambda _: b'{"base": 99999999999999999999999, "zones": []}',
    ),
    Regression(
        "zones of a page",
        "a zone that counts people beyond 64 bits raised OverflowError",
        lambda _: (
            b'{"base": 0, "zones": [{"name": "a", "corners_m": [[0, 0], [0, 2], [2, 0]], '
            b'"count": 33333333333333333333333333}]}'
        ),
    ),
    Regression(
        "file of zones",
        "a zone that counts people beyond 64 bits was read, and could not be sent",
        lambda _: (
            b'{"revision": 4, "zones": [{"name": "a", "corners_m": [[0, 0], [0, 2], [2, 0]], '
            b'"count": 33333333333333333333333333}]}'
        ),
    ),
    Regression(
        "truth in MOT text",
        "a position of 6e19 m was read, and could not be sent",
        lambda _: b"1,7,10,20,30,40,1,2.5,-2.5,66666666666666666666\n[Sequence]\nframeRate=5\n",
    ),
    Regression(
        "plan of a run",
        "text that is not UTF-8 raised UnicodeDecodeError",
        lambda _: b'{"connect":"\xff"',
    ),
    Regression(
        "plan of a run",
        "a process number of -1 raised ValueError",
        lambda _: b'{"connect":"","pid":-1}',
    ),
    Regression("plan of a run", "2e16 replicas of a service filled the memory", _many_replicas),
    Regression(
        "live truth and transforms",
        "a frame whose name cannot be used waited with its poses, and raised at every tick",
        _odd_frame,
    ),
)
