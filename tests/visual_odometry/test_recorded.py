"""Motion in a recording: estimated offline, and published by the process."""

import math
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

import pytest

from common.geometry.transforms import invert
from common.io.images import compress
from common.io.recording import RecordingWriter, open_recording
from evaluation.recordings.visual_motion import (
    FrameMotion,
    VisualMotion,
    VisualMotionJob,
    estimate_motion,
    write_with_motion,
)
from people4d.messages import Detections, Message, Odometry, RgbdFrame
from services.camera.config import CameraConfig
from services.visual_odometry.config import VisualOdometryConfig
from tests import builders
from tests.deploy.launcher.test_alone import (  # noqa: F401  # a fixture is one by its name
    SLOWLY,
    environment,
    people,
    people4d,
    recording,
    service,
)
from tests.visual_odometry.room import BASE_FROM_OPTICAL, INFO, base
from tests.visual_odometry.test_node import MOUNT, found, frame

pytestmark = [pytest.mark.processes, pytest.mark.slow]

FRAMES = 10
WRONG = builders.odometry(stamp_ns=1, x_m=9.0, theta_rad=1.0)


def heading(number: int) -> float:
    return 0.1 * (1 - math.cos(0.25 * number))


@pytest.fixture(scope="module")
def ride(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A turning base with one detected person and wrong odometry."""
    path = tmp_path_factory.mktemp("ride") / "ride.mcap"
    with RecordingWriter(path) as writer:
        for message in (INFO, MOUNT, WRONG):
            writer.write(message, 0)
        for number in range(FRAMES):
            pose = base(theta_rad=heading(number))
            image = frame(pose, number)
            person = (invert(pose @ BASE_FROM_OPTICAL) @ [3.0, 0.5, 1.0, 1.0])[:3]
            writer.write(compress(image), image.stamp_ns)
            writer.write(found(person, number), image.stamp_ns)
    return path


def test_odometry_of_a_recording_is_replaced(ride: Path, tmp_path: Path) -> None:
    messages: list[Message] = [m for _, m in open_recording(ride).messages()]
    visual = VisualMotion(CameraConfig(source=str(ride)), VisualOdometryConfig(), messages)
    motions = list(visual)
    assert len(motions) == FRAMES
    assert visual.counters["unanswered"] == 0
    for number, one in enumerate(motions):
        assert isinstance(one.motion, Odometry)
        assert one.motion.theta_rad == pytest.approx(heading(number), abs=0.004)
        assert one.took_ms > 0

    path = tmp_path / "again.mcap"
    others = [m for m in messages if not isinstance(m, RgbdFrame)]
    write_with_motion(others, motions, path)
    again = [m for _, m in open_recording(path).messages()]
    odometry = [m for m in again if isinstance(m, Odometry)]
    assert [m.stamp_ns for m in odometry] == [one.stamp_ns for one in motions]
    order = [(m.stamp_ns, type(m)) for m in again if isinstance(m, Odometry | Detections)]
    assert order == sorted(order, key=lambda item: (item[0], item[1] is Detections))


def test_estimated_motion_is_cached_without_wheel_odometry(ride: Path, tmp_path: Path) -> None:
    wanted = VisualMotionJob(CameraConfig(source=str(ride)), VisualOdometryConfig(), ride, tmp_path)
    path = estimate_motion(wanted)
    odometry = [m for _, m in open_recording(path).messages(Odometry) if isinstance(m, Odometry)]
    assert len(odometry) == FRAMES
    assert max(m.x_m for m in odometry) < 0.1  # wheel odometry is 9 m
    made_ns = path.stat().st_mtime_ns
    assert estimate_motion(wanted) == path
    assert path.stat().st_mtime_ns == made_ns
    other = VisualOdometryConfig(sideways=1.0)
    assert estimate_motion(VisualMotionJob(wanted.camera, other, ride, tmp_path)) != path


def test_frames_without_motion_are_not_written(ride: Path, tmp_path: Path) -> None:
    path = tmp_path / "none.mcap"
    messages = [m for _, m in open_recording(ride).messages()]
    write_with_motion(messages, [FrameMotion(0, None, 0.0)], path)
    assert not list(open_recording(path).messages(Odometry))


def test_the_process_publishes_odometry(
    ride: Path,
    tmp_path: Path,
    environment: Mapping[str, str],  # noqa: F811
) -> None:
    out = tmp_path / "odometry.mcap"
    with ExitStack() as stack:
        stack.enter_context(service("visual_odometry", environment))
        stack.enter_context(recording(out, "odometry", environment))
        topics = "frames,camera_info,static_transforms,detections"
        people4d(environment, "replay", str(ride), "--topics", topics, *SLOWLY)
    odometry = [m for m in people(out, Odometry) if isinstance(m, Odometry)]
    assert len(odometry) >= FRAMES // 2
    for one in odometry:
        number = round(one.stamp_ns / 66_666_667)
        assert one.theta_rad == pytest.approx(heading(number), abs=0.006)
