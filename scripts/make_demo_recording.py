"""Make the demo recording from a folder of the virtual lab.

    python scripts/make_demo_recording.py ../shared/data/lab/two deploy/demo/two_people.mcap

The folder holds rgb/*.jpg, depth/*.png (16 bits, mm) and gt.npz (t, K, T_world_cam, pos, vel, yaw).
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from common.images import decode_png16, encode_png16
from common.messages import (
    CameraInfo,
    CompressedRgbdFrame,
    Message,
    StaticTransform,
    Truth,
    TruthPerson,
)
from common.recording import RecordingWriter, open_recording

CAMERA = "front"
OPTICAL_FRAME = "front_optical_frame"
START_NS = 1_700_000_000 * 10**9  # any epoch; the people are simulated
EVERY = 2  # of the frames are kept: 15 of 30 per second
PNG_LEVEL = 9


def main() -> None:
    """Write the recording and say what it holds."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("recording", type=Path)
    flags = parser.parse_args()
    truth = dict(np.load(flags.folder / "gt.npz"))
    messages = [*_calibration(truth), *_frames(flags.folder, truth["t"]), *_truth(truth)]
    with RecordingWriter(flags.recording) as writer:
        # Sorting is stable: the calibration comes before the first frame.
        for message in sorted(messages, key=lambda m: m.stamp_ns):
            writer.write(message, message.stamp_ns)
    print(open_recording(flags.recording).summary, flags.recording.stat().st_size, "bytes")


def _stamp_ns(t_s: float) -> int:
    return START_NS + round(t_s * 1e9)


def _calibration(truth: dict[str, Any]) -> list[Message]:
    """Return calibration and pose of the camera, which stands still."""
    fx, fy, cx, cy = map(float, truth["K"])
    height, width = truth["masks"].shape[1:]
    info = CameraInfo(
        stamp_ns=START_NS,
        sequence=0,
        camera=CAMERA,
        frame_id=OPTICAL_FRAME,
        width=width,
        height=height,
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
    )
    pose = StaticTransform(
        stamp_ns=START_NS,
        sequence=0,
        parent="map",
        child=OPTICAL_FRAME,
        matrix=truth["T_world_cam"][0],
    )
    return [info, pose]


def _frames(folder: Path, t_s: Any) -> list[Message]:
    """Return the frames kept, colour byte for byte, depth repacked."""
    names = sorted(path.stem for path in (folder / "rgb").glob("*.jpg"))[::EVERY]
    return [
        CompressedRgbdFrame(
            stamp_ns=_stamp_ns(t),
            sequence=sequence,
            camera=CAMERA,
            rgb_jpeg=(folder / "rgb" / f"{name}.jpg").read_bytes(),
            depth_png=_repack((folder / "depth" / f"{name}.png").read_bytes()),
        )
        for sequence, (name, t) in enumerate(zip(names, t_s[::EVERY], strict=True))
    ]


def _repack(png: bytes) -> bytes:
    return encode_png16(decode_png16(png), PNG_LEVEL)


def _truth(truth: dict[str, Any]) -> list[Message]:
    """Return the people at each original stamp, 30 per second."""
    return [
        Truth(
            stamp_ns=_stamp_ns(truth["t"][row]),
            sequence=row,
            frame_id="map",
            people=tuple(
                TruthPerson(
                    id=str(k),
                    position_m=truth["pos"][row, k],
                    velocity_mps=truth["vel"][row, k],
                    yaw_rad=float(truth["yaw"][row, k]),
                )
                for k in range(truth["pos"].shape[1])
            ),
        )
        for row in range(len(truth["t"]))
    ]


if __name__ == "__main__":
    main()
