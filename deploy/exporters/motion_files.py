"""Files of motion capture: TRC (OpenSim), C3D and BVH of the joints of a person.

Axes as in OpenSim: x ahead in the map, y up, z to its right. Lengths are in millimetres.
Unknown joints are empty in TRC and have a residual of -1 in C3D.
"""

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from deploy.exporters.bvh import bvh
from evaluation.gait.motion import JointMotion
from evaluation.report.csv_files import write_bytes
from people4d.messages import F64
from people4d.messages.skeleton import JOINTS

BLOCK = 512  # Size of a block of a C3D file [bytes]
INTEL, MAGIC = 84, 0x50  # Byte order and mark of a C3D file
FRAMES_MAX = 65535  # Maximum number of a frame in the header


def write_motion(folder: Path, name: str, motion: JointMotion) -> None:
    """Write NAME.trc, NAME.c3d and NAME.bvh.

    Raises:
        SourceError: A file cannot be written.
    """
    write_bytes(folder / f"{name}.trc", trc(f"{name}.trc", motion).encode())
    write_bytes(folder / f"{name}.c3d", c3d(motion))
    write_bytes(folder / f"{name}.bvh", bvh(motion).encode())


def trc(name: str, motion: JointMotion) -> str:
    """Return the TRC file of a motion."""
    points = _positions_mm(motion)
    rate, count = f"{motion.rate_hz:g}", len(points)
    columns = [f"{axis}{k}" for k in range(1, len(JOINTS) + 1) for axis in "XYZ"]
    lines = [
        ["PathFileType", "4", "(X/Y/Z)", name],
        [
            *("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units"),
            *("OrigDataRate", "OrigDataStartFrame", "OrigNumFrames"),
        ],
        [rate, rate, str(count), str(len(JOINTS)), "mm", rate, "1", str(count)],
        ["Frame#", "Time", *(cell for joint in JOINTS for cell in (joint, "", ""))],
        ["", "", *columns],
        [],
    ]
    for frame, (time_s, row) in enumerate(zip(motion.times_s, points, strict=True), 1):
        cells = ["" if np.isnan(value) else f"{value:.2f}" for value in row.ravel()]
        lines.append([str(frame), f"{time_s:.6f}", *cells])
    return "\n".join("\t".join(line) for line in lines) + "\n"


def c3d(motion: JointMotion) -> bytes:
    """Return the C3D file of a motion: blocks of header, parameters and positions."""
    points = _positions_mm(motion)
    count = len(points)
    parameters = _parameters(motion, data_start=0)
    data_start = 2 + len(parameters) // BLOCK
    parameters = _parameters(motion, data_start)
    known = np.isfinite(points).all(axis=2, keepdims=True)
    residuals = np.where(known, 0.0, -1.0)
    data = np.concatenate([np.where(known, points, 0.0), residuals], axis=2).astype("<f4")
    header = struct.pack(
        "<BBHHHHHfHHf",
        *(2, MAGIC, len(JOINTS), 0, 1, min(count, FRAMES_MAX), 0, -1.0, data_start, 0),
        motion.rate_hz,
    )
    return _padded(header) + parameters + _padded(data.tobytes())


def _parameters(motion: JointMotion, data_start: int) -> bytes:
    """Return the blocks of parameters; their length does not depend on `data_start`."""
    count = len(motion.joints_m)
    width = max(map(len, JOINTS))
    labels = "".join(joint.ljust(width) for joint in JOINTS).encode()
    ends = [struct.pack("<HH", frame % 65536, frame // 65536) for frame in (1, count)]
    point = [
        _parameter(1, "USED", 2, (), struct.pack("<H", len(JOINTS))),
        _parameter(1, "SCALE", 4, (), struct.pack("<f", -1.0)),
        _parameter(1, "RATE", 4, (), struct.pack("<f", motion.rate_hz)),
        _parameter(1, "DATA_START", 2, (), struct.pack("<H", data_start)),
        _parameter(1, "FRAMES", 2, (), struct.pack("<H", min(count, FRAMES_MAX))),
        _parameter(1, "LABELS", -1, (width, len(JOINTS)), labels),
        _parameter(1, "UNITS", -1, (2,), b"mm"),
    ]
    extent = [
        _parameter(2, name, 2, (2,), end)
        for name, end in zip(("ACTUAL_START_FIELD", "ACTUAL_END_FIELD"), ends, strict=True)
    ]
    analog = [_parameter(3, "USED", 2, (), struct.pack("<H", 0))]
    body = b"".join(
        struct.pack("<bb", len(name), -number) + name.encode() + struct.pack("<hb", 3, 0) + content
        for number, (name, content) in enumerate(
            (("POINT", b"".join(point)), ("TRIAL", b"".join(extent)), ("ANALOG", b"".join(analog))),
            1,
        )
    )
    blocks = -(-(4 + len(body) + 2) // BLOCK)
    return _padded(struct.pack("<BBBB", 1, MAGIC, blocks, INTEL) + body + b"\0\0")


def _parameter(group: int, name: str, kind: int, sizes: Sequence[int], data: bytes) -> bytes:
    """Return one parameter; `kind` is the length of a value [bytes], -1 for text."""
    content = struct.pack(f"<bB{len(sizes)}B", kind, len(sizes), *sizes) + data + b"\0"
    start = struct.pack("<bb", len(name), group) + name.encode()
    return start + struct.pack("<h", 2 + len(content)) + content


def _padded(data: bytes) -> bytes:
    return data + b"\0" * (-len(data) % BLOCK)


def _positions_mm(motion: JointMotion) -> F64:
    """Return the joints with y up, Tx17x3 [mm]."""
    return 1000 * motion.joints_m[..., (0, 2, 1)] * (1.0, 1.0, -1.0)
