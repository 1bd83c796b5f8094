"""Readers of foreign files: recordings, bags, folders, truth."""

import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import scipy.io

from common.io.images import encode_jpeg
from common.io.recording import RecordingWriter, open_recording
from people4d.errors import People4dError
from services.camera.calibration import read_calibration
from services.camera.describe import describe
from services.camera.folder.source import FolderOptions, FolderSource
from services.camera.recording import RecordingOptions, RecordingSource
from services.camera.ros.camera import RosbagOptions
from services.camera.ros.source import RosbagSource
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.sources.registry import TRUTH_SOURCES, open_truth
from tests.camera.ros.bags import Ros, depth_mm, frames, rgb
from tests.camera.test_sources import recorded
from tests.contract.examples import FULL
from tests.fuzz.target import Target

CALIBRATION = "image_width: 8\nimage_height: 6\ncamera_matrix: {rows: 3, cols: 3, data: " + (
    "[10., 0., 4., 0., 10., 3., 0., 0., 1.]}\ndistortion_coefficients: {data: [0.1, 0, 0, 0, 0]}\n"
)
TABLE = "[colour]\nfx=10.0\nfy=10.0\ncx=4.0\ncy=3.0\ndistortion=[0.1, 0, 0, 0]\n"
SUFFIXES = (".toml", ".json", ".yaml", ".npz", ".mat")
ITEMS = 64  # read of one source: endless playback is no fault
BIG = 65536


def _file(name: str, *readers: Callable[[Path], object]) -> Callable[[bytes, Path], None]:
    """Return a function that writes the bytes to a file and passes it to each reader."""

    def read(data: bytes, folder: Path) -> None:
        path = folder / name
        path.write_bytes(data)
        for reader in readers:
            with contextlib.suppress(People4dError):
                reader(path)

    return read


def _play(source: Any) -> None:
    for _, item in zip(range(ITEMS), source, strict=False):
        assert item is not None


def _recording(path: Path) -> None:
    recording = open_recording(path)
    assert recording.summary.duration_s >= 0
    assert recording.metadata is not None
    for _ in recording.messages():
        pass


def _truth(kind: str) -> Callable[[Path], None]:
    assert kind in TRUTH_SOURCES
    return lambda path: _play(open_truth(GtBridgeConfig(truth=str(path), source=kind)))


def _recording_seeds(folder: Path) -> Sequence[bytes]:
    with RecordingWriter(folder / "all.mcap") as writer:
        writer.write_metadata("lab", {"scenario": "two", "seed": "1", "depth": "clean"})
        for message in FULL:
            writer.write(message, message.sequence)
    return [recorded(folder / "a.mcap").read_bytes(), (folder / "all.mcap").read_bytes()]


def _bag_seeds(version: int, ending: str) -> Callable[[Path], Sequence[bytes]]:
    def seeds(folder: Path) -> Sequence[bytes]:
        ros = Ros(version)
        entries = frames(ros, 2)
        path = ros.write(folder / f"bag{ending if version == 1 else ending[1:]}", entries)
        return [(path if version == 1 else next(path.glob(f"*{ending}"))).read_bytes()]

    return seeds


def _bag(path: Path) -> None:
    _play(RosbagSource(path, RosbagOptions(depth_aligned=True)))


def _metadata(data: bytes, folder: Path) -> None:
    if not list(folder.glob("*.db3")):
        Ros(2).write(folder / "bag", frames(Ros(2), 1))
        (folder / "bag" / "bag.db3").rename(folder / "bag.db3")
    (folder / "metadata.yaml").write_bytes(data)
    with contextlib.suppress(People4dError):
        _bag(folder)


def _metadata_seeds(folder: Path) -> Sequence[bytes]:
    return [(Ros(2).write(folder / "bag", frames(Ros(2), 1)) / "metadata.yaml").read_bytes()]


def _calibration(data: bytes, folder: Path) -> None:
    path = folder / f"camera{SUFFIXES[(data[0] if data else 0) % len(SUFFIXES)]}"
    path.write_bytes(data[1:])
    read_calibration(path)


def _calibration_seeds(folder: Path) -> Sequence[bytes]:
    np.savez(folder / "a.npz", K=np.array([10.0, 10, 4, 3]), T_world_cam=np.eye(4)[None])
    camera = {"K": np.eye(3), "DistCoef": np.zeros(5)}
    arrays = {"RGB_cam": camera, "Depth_cam": camera, "R_d_to_rgb": np.eye(3)}
    scipy.io.savemat(folder / "a.mat", arrays | {"T_d_to_rgb": np.zeros(3)})
    texts = [TABLE, '{"fx":10,"fy":10,"cx":4,"cy":3}', CALIBRATION]
    seeds = [text.encode() for text in texts]
    seeds += [(folder / name).read_bytes() for name in ("a.npz", "a.mat")]
    return [bytes([number]) + seed for number, seed in enumerate(seeds)]


def _images(data: bytes, folder: Path) -> None:
    """Play a folder: two lists, one colour and one depth image, each after its length."""
    parts, rest = [], data
    for _ in range(3):
        size = int.from_bytes(rest[:2], "little")
        parts.append(rest[2 : 2 + size])
        rest = rest[2 + size :]
    names = ("rgb.txt", "depth.txt", "a.png", "b.png")
    for name, part in zip(names, (*parts, rest), strict=True):
        (folder / name).write_bytes(part)
    (folder / "camera.toml").write_text(TABLE)
    _play(FolderSource(folder, FolderOptions()))


def _images_seeds(_: Path) -> Sequence[bytes]:
    depth = cv2.imencode(".png", depth_mm())[1].tobytes()
    seeds = []
    for colour in (cv2.imencode(".png", rgb())[1].tobytes(), encode_jpeg(rgb())):
        parts = (b"1.5 a.png\n# x\n", b"1.51 b.png\n2.5 ../c.png\n"[:11], colour)
        sized = b"".join(len(part).to_bytes(2, "little") + part for part in parts)
        seeds.append(sized + depth)
    return seeds


def _arrays(data: bytes, folder: Path) -> None:
    path = folder / "gt.npz"
    path.write_bytes(data)
    if not (folder / "1.mat").exists():
        cv2.imwrite(str(folder / "1.png"), rgb())
        scipy.io.savemat(folder / "1.mat", {"depth_array": depth_mm()})
    for reader in (_truth("npz"), lambda _: _play(FolderSource(folder, FolderOptions()))):
        with contextlib.suppress(People4dError):
            reader(path)


def _arrays_seeds(folder: Path) -> Sequence[bytes]:
    arrays = {"t": np.arange(2.0), "K": np.array([10.0, 10, 4, 3])}
    arrays |= {"odom": np.zeros((2, 3)), "T_world_cam": np.stack([np.eye(4)] * 2)}
    arrays |= {"pos": np.zeros((2, 1, 3)), "vel": np.zeros((2, 1, 3)), "yaw": np.zeros((2, 1))}
    np.savez(folder / "a.npz", **arrays)  # type: ignore[arg-type]
    np.savez_compressed(folder / "b.npz", **arrays)  # type: ignore[arg-type]
    return [(folder / name).read_bytes() for name in ("a.npz", "b.npz")]


def _depth_mat(data: bytes, folder: Path) -> None:
    cv2.imwrite(str(folder / "1.png"), rgb())
    (folder / "1.mat").write_bytes(data)
    (folder / "camera.toml").write_text(TABLE)
    _play(FolderSource(folder, FolderOptions()))


def _depth_mat_seeds(folder: Path) -> Sequence[bytes]:
    scipy.io.savemat(folder / "a.mat", {"depth_array": depth_mm()})
    scipy.io.savemat(folder / "b.mat", {"depth_array": depth_mm()}, do_compression=True)
    return [(folder / name).read_bytes() for name in ("a.mat", "b.mat")]


def _mot(data: bytes, folder: Path) -> None:
    rows, _, info = data.partition(b"[")
    (folder / "gt.txt").write_bytes(rows)
    (folder / "seqinfo.ini").write_bytes(b"[" + info)
    _truth("mot")(folder / "gt.txt")


def _mot_seeds(_: Path) -> Sequence[bytes]:
    info = b"[Sequence]\nname=x\nframeRate=25\nseqLength=3\nimWidth=640\nimHeight=480\n"
    return [
        b"1,7,10,20,30,40,1,1.5,-2.5,0\n3,7,10,20,30,40,1,2.5,-2.5,0.25\n2,8,1,1,2,2,0\n" + info
    ]


def _csv_seeds(_: Path) -> Sequence[bytes]:
    return [
        b"kind,stamp_ns,frame_id,id,x_m,y_m,z_m,vx_mps,vy_mps,vz_mps,yaw_rad,path_yaw_rad\n"
        b"truth,1,map,anna,1,2,3,0.5,0,0,1.5,\ntrack,1,map,7,1,2,3,,,,,\ntruth,2,,b,1,2,3,,,,,\n",
        b'stamp_ns,id,x_m,y_m,z_m\n5,"a,b",1e3,-2,nan\n',
    ]


def _target(name: str, file: str, *readers: Callable[[Path], object], **rest: Any) -> Target:
    return Target(name, _file(file, *readers), **rest)


TARGETS = (
    _target(
        "recording (MCAP)",
        "a.mcap",
        _recording,
        lambda path: _play(RecordingSource(path, RecordingOptions(depth_sensor="off"))),
        _truth("recording"),
        seeds=_recording_seeds,
        max_bytes=BIG,
    ),
    _target("ROS 1 bag", "a.bag", _bag, describe, seeds=_bag_seeds(1, ".bag"), max_bytes=BIG),
    _target("ROS 2 bag (MCAP)", "a.mcap", _bag, seeds=_bag_seeds(2, ".mcap"), max_bytes=BIG),
    _target("ROS 2 bag (SQLite)", "a.db3", _bag, seeds=_bag_seeds(2, ".db3"), max_bytes=BIG),
    Target("ROS 2 bag (metadata.yaml)", _metadata, _metadata_seeds),
    Target("folder of images", _images, _images_seeds, (b"../", b"/", b"a.png", b"b.png")),
    Target("folder with gt.npz", _arrays, _arrays_seeds, (b"'descr'", b"'shape'", b"<f8", b"|O")),
    Target("folder with .mat", _depth_mat, _depth_mat_seeds),
    Target("calibration", _calibration, _calibration_seeds, (b"&a", b"*a", b"<<", b"data")),
    _target("truth in CSV", "a.csv", _truth("csv"), seeds=_csv_seeds, words=(b"nan", b"1e999")),
    Target("truth in MOT text", _mot, _mot_seeds, (b"1e999", b"nan", b"%(name)s")),
)
