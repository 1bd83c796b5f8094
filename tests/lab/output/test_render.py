"""Rendering: outputs, resuming, and bytes that depend on the job only."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from common.io.images import decode_jpeg, decode_png16
from common.io.recording import open_recording
from lab.catalogue import load_scenario
from lab.depth.metadata import read_metadata
from lab.output import render as job
from lab.output.chunks import ChunkStore
from lab.output.render import Outputs, render
from lab.output.sequence import Fidelity, RenderJob
from lab.source import LabOptions, LabSource
from people4d.errors import SourceError
from people4d.messages import (
    CameraInfo,
    CompressedRgbdFrame,
    Detections,
    Odometry,
    StaticTransform,
    Tracks,
    Truth,
)
from services.camera.recording import RecordingOptions, RecordingSource
from services.camera.ros.camera import RosbagOptions
from services.camera.ros.source import RosbagSource
from services.camera.source import SourceFrame
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.sources.files import RecordingTruth
from services.gt_bridge.sources.ros import RosbagTruth
from services.tracker.build import build
from services.tracker.config import TrackerConfig
from tests.lab.scenarios import DRIVE, EPOCH_NS, FRAMES, SIZE, write_scenario

pytestmark = pytest.mark.render


@pytest.fixture(scope="module", autouse=True)
def _small_pieces() -> Iterator[None]:
    """Five frames in a piece, so that a short scenario has three of them."""
    pieces: dict[Fidelity, int] = {"geometry": 5, "depth": 5, "colour": 5}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(job, "CHUNK_FRAMES", pieces)
        yield


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of all outputs of one job, drawn without interruption by one process."""
    folder = tmp_path_factory.mktemp("finished")
    outputs = Outputs(folder / "out.mcap", bag=folder / "out_ros2", truth=folder / "out.npz")
    render(order(folder, truth_per_frame=True), outputs, 1, lambda *_: None)
    return folder


def order(
    folder: Path, fidelity: Fidelity = "depth", camera: str = "", **fields: object
) -> RenderJob:
    scenario = load_scenario(str(write_scenario(folder, camera)))
    return RenderJob(scenario=scenario, seed=scenario.seed, fidelity=fidelity, **fields)  # type: ignore[arg-type]


def rendered(folder: Path, wanted: RenderJob, name: str = "out.mcap", jobs: int = 1) -> Path:
    render(wanted, Outputs(recording=folder / name), jobs, lambda *_: None)
    return folder / name


def captures(path: Path) -> list[SourceFrame]:
    source = RecordingSource(path, RecordingOptions())
    return [item for item in source if isinstance(item, SourceFrame)]


def test_recording_holds_frames_calibration_pose_and_truth(finished: Path) -> None:
    recording = open_recording(finished / "out.mcap")
    assert recording.summary.topics == {
        "camera/front/info": 1,
        "transforms/front_optical_frame": 1,
        "raw/front/compressed": FRAMES,
        "truth": 121,  # 100 Hz for 1.2 s, first and last included
    }
    kinds = [type(message) for _, message in recording.messages()]
    assert kinds[:2] == [CameraInfo, StaticTransform]
    frames = [m for _, m in recording.messages(CompressedRgbdFrame)]
    assert [m.stamp_ns for m in frames] == [EPOCH_NS + k * 10**8 for k in range(FRAMES)]
    assert [m.sequence for m in frames] == list(range(FRAMES))
    note = read_metadata(recording)
    assert note is not None
    assert (note.scenario, note.seed, note.depth) == ("walk", 5, "clean")
    assert not (finished / "out.mcap.part").exists()


def test_clean_depth_is_exact_and_played_as_a_sensor_measures_it(
    finished: Path, tmp_path: Path
) -> None:
    clean = finished / "out.mcap"
    measured = rendered(tmp_path, order(tmp_path, depth="measured"), "measured.mcap")
    source = LabSource(
        str(tmp_path / "walk.toml"), LabOptions(mode="depth", depth_sensor="off", threads=1)
    )
    taken = [item for item in source if isinstance(item, SourceFrame)]
    frames = [m for _, m in open_recording(clean).messages(CompressedRgbdFrame)]
    for frame, capture in zip(frames, taken, strict=True):
        assert isinstance(frame, CompressedRgbdFrame)
        assert np.array_equal(decode_png16(frame.depth_png), capture.depth_mm)
        assert np.abs(decode_jpeg(frame.rgb_jpeg).astype(int) - capture.rgb).mean() < 4
    # Played, both have the errors of the same sensor; only the shadow of the second imager is
    # computed from the first one's view in one, and drawn in the other.
    for a, b in zip(captures(clean), captures(measured), strict=True):
        assert (a.depth_mm != b.depth_mm).mean() < 0.05
    assert not np.array_equal(captures(clean)[0].depth_mm, taken[0].depth_mm)


def test_the_bytes_do_not_depend_on_the_number_of_processes(finished: Path, tmp_path: Path) -> None:
    two = rendered(tmp_path, order(tmp_path), jobs=2)
    assert two.read_bytes() == (finished / "out.mcap").read_bytes()


def test_interrupted_rendering_is_continued(finished: Path, tmp_path: Path) -> None:
    """Stopped after each piece in turn, it gives the bytes of one that was not stopped."""
    wanted = order(tmp_path, truth_per_frame=True)
    outputs = Outputs(recording=tmp_path / "out.mcap", truth=tmp_path / "out.npz")
    shares: list[float] = []

    def stop(_: str, share: float) -> None:
        shares.append(share)
        if len(shares) % 2 == 0 and share < 1:
            raise KeyboardInterrupt

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            render(wanted, outputs, 1, stop)
    assert not outputs.paths[0].exists()
    unchanged = sorted(path.name for path in (tmp_path / "out.mcap.part").iterdir())
    assert unchanged == ["000000", "000000.npz", "000001", "000001.npz", "key"]
    render(wanted, outputs, 1, stop)
    # Each round adds one of three pieces to the existing file.
    assert shares == pytest.approx([0, 1 / 3, 1 / 3, 2 / 3, 2 / 3, 1])
    for path in outputs.paths:
        assert path.read_bytes() == (finished / path.name).read_bytes()
    assert not (tmp_path / "out.mcap.part").exists()


def test_chunks_of_another_job_are_not_used(finished: Path, tmp_path: Path) -> None:
    wanted, other = order(tmp_path), order(tmp_path, quality=50)
    outputs = Outputs(recording=tmp_path / "out.mcap")
    job.render_chunk(other, ChunkStore(outputs.chunks, job._key(other)), 5, 0)
    before = outputs.chunks / "000000"
    assert before.exists()
    render(wanted, outputs, 1, lambda *_: None)
    assert outputs.paths[0].read_bytes() == (finished / "out.mcap").read_bytes()


def test_truth_of_each_frame(finished: Path) -> None:
    with np.load(finished / "out.npz") as truth:
        assert truth["t"] == pytest.approx(np.arange(FRAMES) / 10)
        assert truth["masks"].shape == (FRAMES, *SIZE)
        assert truth["kp2d"].shape == (FRAMES, 2, 17, 2)
        assert truth["K"] == pytest.approx([77.0, 77.0, 39.5, 29.5])
        # Adam walks from y = -0.6 towards 0.6: he is on the right, then farther left.
        u = [np.nonzero(mask == 1)[1].mean() for mask in truth["masks"][[0, -1]]]
        assert u[0] > u[1] + 5


def test_a_robot_brings_its_odometry(tmp_path: Path) -> None:
    path = rendered(tmp_path, order(tmp_path, camera=DRIVE))
    messages = [m for _, m in open_recording(path).messages()]
    assert sum(isinstance(m, Odometry) for m in messages) == 61
    parents = [(m.parent, m.child) for m in messages if isinstance(m, StaticTransform)]
    assert parents == [("base_link", "front_optical_frame"), ("map", "odom")]
    stamps = [m.stamp_ns for m in messages]
    assert stamps == sorted(stamps)
    played = RecordingSource(path, RecordingOptions()).transforms
    assert [(t.parent, t.child) for t in played] == parents


def test_geometry_gives_detections_instead_of_frames(tmp_path: Path) -> None:
    path = rendered(tmp_path, order(tmp_path, "geometry"))
    recording = open_recording(path)
    found = [m for _, m in recording.messages(Detections)]
    assert [m.sequence for m in found] == list(range(FRAMES))
    assert not list(recording.messages(CompressedRgbdFrame))
    assert sum(isinstance(m, Truth) for _, m in recording.messages()) == 121
    # Both are seen all the time; a detector misses one in a hundred.
    people = [len(m.detections) for m in found if isinstance(m, Detections)]
    assert np.median(people) == 2
    # A tracker finds the people without images, at the positions of motion capture.
    config = TrackerConfig(tracker="sort3d")
    tracker = build(config)
    messages = [m for _, m in recording.messages(StaticTransform, Detections)]
    error_text = [t for m in messages for t in tracker.handle(m, 0) if isinstance(t, Tracks)]
    tracks = [t for t in error_text if t.tracks][-1].tracks
    *_, truth = (m for _, m in recording.messages(Truth) if isinstance(m, Truth))
    for person in truth.people:
        off_m = [np.hypot(*(t.position_m - person.position_m)[:2]) for t in tracks]
        assert min(off_m) < 0.3


def test_a_second_of_colour(tmp_path: Path) -> None:
    path = rendered(tmp_path, order(tmp_path, "colour"))
    first, last = captures(path)[0].rgb, captures(path)[-1].rgb
    assert first.std() > 20
    assert np.abs(first.astype(int) - last).mean() > 2  # people walked


def test_a_bag_plays_as_the_recording_does(finished: Path) -> None:
    bag = RosbagSource(finished / "out_ros2", RosbagOptions())
    theirs = [item for item in bag if isinstance(item, SourceFrame)]
    for a, b in zip(captures(finished / "out.mcap"), theirs, strict=True):
        assert a.stamp_ns == b.stamp_ns
        assert np.array_equal(a.rgb, b.rgb)
        assert np.array_equal(a.depth_mm, b.depth_mm)  # as measured by the sensor
    assert bag.transforms[0].parent == "map"
    ours = RecordingTruth(GtBridgeConfig(truth=str(finished / "out.mcap")))
    error_text = RosbagTruth(GtBridgeConfig(truth=str(finished / "out_ros2")))
    for one, other in zip(ours, error_text, strict=True):
        assert one.stamp_ns == other.stamp_ns
        for p, q in zip(one.people, other.people, strict=True):
            assert (p.id, p.yaw_rad, p.path_yaw_rad) == (q.id, q.yaw_rad, q.path_yaw_rad)
            assert np.array_equal(p.position_m, q.position_m)


def test_existing_output_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "out.mcap").write_text("precious")
    with pytest.raises(SourceError, match=r"out\.mcap exists already"):
        rendered(tmp_path, order(tmp_path))
    assert (tmp_path / "out.mcap").read_text() == "precious"
