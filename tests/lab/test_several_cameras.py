"""Several cameras in one world: the same people, seen at other times and on other clocks."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from common.geometry.transforms import apply, invert, project
from common.io.recording import open_recording
from lab.camera.plan import CameraPlan
from lab.camera.synthetic_detections import SyntheticDetections, SyntheticDetectionsConfig
from lab.catalogue import load_scenario
from lab.depth.config import DepthSensorModel
from lab.output.render import Outputs, render
from lab.output.sequence import RenderJob, SequenceRenderer
from lab.scenario import Scenario
from lab.source import LabOptions, LabSource
from lab.world import EPOCH_NS, World
from people4d.codec import encode
from people4d.errors import ConfigError
from people4d.messages import CameraInfo, Detections, Odometry

EXACT = SyntheticDetectionsConfig(
    keypoint_share=0, keypoint_least_px=0, false_alarms=0, no_position=0, recall=1
)
SENSORLESS = msgspec.structs.replace(EXACT, sensor=DepthSensorModel(noise_px=0))


def scene(options: str = "", cameras: int = 3) -> Scenario:
    query = f"random?cameras={cameras}&people=2&duration_s=2&depth_sensor=d435i{options}"
    return load_scenario(query)


def test_stamp_is_that_of_the_cameras_own_clock() -> None:
    # 0.2 s ahead, 100 ppm fast, first frame after 10 ms: frame 50 at 10 Hz is taken at 5.01 s,
    # when its clock shows 5.01 + 0.2 + 0.000501 s.
    plan = CameraPlan(fps=10, phase_s=0.01, clock_offset_s=0.2, clock_drift_ppm=100)
    world = World(msgspec.structs.replace(scene(), camera=plan))
    assert world.frame_s(50) == pytest.approx(5.01)
    assert world.stamp_ns(50) - EPOCH_NS == pytest.approx(5_210_501_000, abs=2)
    assert world.time_ns(world.stamp_ns(50)) - EPOCH_NS == pytest.approx(5_010_000_000, abs=2)


def test_cameras_see_the_same_people_at_the_same_position() -> None:
    world = World(scene())
    found = []
    for view in world.views:
        detector = SyntheticDetections(SENSORLESS, view.info, view.noise_seed)
        pose = view.optical_from_map(1.0)
        people = detector.at(world.keypoints_m(1.0), pose, EPOCH_NS).detections
        known = [p.position_m for p in people if p.position_m is not None]
        found.append(apply(invert(pose), np.array(known).reshape(-1, 3)))
    positions = np.concatenate(found)
    truth = np.array([points[[5, 6, 11, 12]].mean(axis=0) for points in world.keypoints_m(1.0)])
    distances = np.linalg.norm(positions[:, None] - truth, axis=-1).min(axis=1)
    assert len(positions) >= 3
    assert distances.max() < 0.05


def test_first_camera_is_the_same_with_and_without_others() -> None:
    plan = scene()
    alone = msgspec.structs.replace(plan, cameras=())
    both, one = (
        SequenceRenderer(RenderJob(scenario=s, seed=3, fidelity="geometry")) for s in (plan, alone)
    )
    frames = [both.frame(k)[0] for k in range(both.frame_count)]
    first = [encode(m) for m in frames if isinstance(m, Detections) and m.camera == "c1"]
    assert first == [encode(one.frame(k)[0]) for k in range(one.frame_count)]


def test_errors_of_cameras_are_independent() -> None:
    seeds = {view.noise_seed for view in World(scene(), 3).views}
    assert len(seeds) == 3
    assert 3 in seeds


@pytest.mark.parametrize("count", [2, 4, 6])
def test_ring_sees_its_middle_with_every_camera_and_apart_shares_no_floor(count: int) -> None:
    for view in World(scene(cameras=count)).views:
        (pixel,) = project(apply(view.optical_from_map(0), np.zeros((1, 3))), view.info)
        assert 0 < pixel[0] < 639
    world = World(scene("&layout=apart", count))
    x, y = np.meshgrid(np.arange(-16, 16, 0.1), np.arange(1.6, 3.5, 0.1))
    torsos = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 1.1)])
    in_view = []
    for view in world.views:
        ahead = apply(view.optical_from_map(0), torsos)
        pixels = project(ahead, view.info)
        in_view.append((np.abs(pixels[:, 0] - 319.5) < 319.5) & (ahead[:, 2] > 0.5))
    assert (np.sum(in_view, axis=0) <= 1).all()
    assert np.sum(in_view) > 0


def test_recording_has_all_cameras_in_the_order_of_true_time(tmp_path: Path) -> None:
    plan = scene("&clocks=free&robot=true")
    job, path = RenderJob(scenario=plan, seed=1, fidelity="geometry"), tmp_path / "a.mcap"
    render(job, Outputs(recording=path), 1, lambda *_: None)
    recorded = list(open_recording(path).messages())
    cameras = {m.camera for _, m in recorded if isinstance(m, Detections)}
    assert cameras == {m.camera for _, m in recorded if isinstance(m, CameraInfo)}
    assert cameras == {"c1", "c2", "robot"}
    assert any(isinstance(m, Odometry) for _, m in recorded)
    views = {view.info.camera: view for view in World(plan, 1).views}
    frames = [(time_ns, m) for time_ns, m in recorded if isinstance(m, Detections)]
    assert [t for t, _ in frames] == sorted(t for t, _ in frames)
    for time_ns, frame in frames:
        assert abs(views[frame.camera].time_ns(frame.stamp_ns) - time_ns) <= 2
    assert len(frames) == sum(view.frame_count for view in views.values())


def test_source_is_the_camera_that_is_named() -> None:
    name = "random?cameras=2&people=1&duration_s=1"
    assert LabSource(name, LabOptions(camera="c2")).info.camera == "c2"
    assert LabSource(name, LabOptions()).info.camera == "c1"
    with pytest.raises(ConfigError, match="no camera c3"):
        LabSource(name, LabOptions(camera="c3"))


def test_cameras_of_one_name_are_refused() -> None:
    first = scene().cameras[0]
    with pytest.raises(ValueError, match="different names, got c2, c2"):
        msgspec.convert({**msgspec.to_builtins(scene(cameras=2)), "camera": first}, Scenario)


def test_phase_beyond_a_frame_is_refused() -> None:
    with pytest.raises(ValueError, match=r"phase_s: expected < 0\.1"):
        CameraPlan(fps=10, phase_s=0.1)
