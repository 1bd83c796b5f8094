"""Launch requests and their services."""

from pathlib import Path

import pytest

from common.config import setting
from deploy.compose import Service
from deploy.launcher.plan import LaunchRequest, check_settings, plan
from people4d.errors import ConfigError, People4dError, SourceError


def planned(launch: LaunchRequest) -> dict[str, Service]:
    return {service.name: service for service in plan(launch)}


def test_settings_reach_their_service_in_order() -> None:
    launch = LaunchRequest(
        settings=["tracker.sort3d.t_lost=5", "tracker.frame_id=odom"], environment={}
    )
    services = planned(launch)
    assert services["tracker"].command[3:] == (
        *("--set", "sort3d.t_lost=5"),
        *("--set", "frame_id=odom"),
    )
    assert services["detector"].command[3:] == ()


def test_text_that_resembles_a_number_stays_text() -> None:
    assert setting("camera.source", 'a "b" 7') == 'camera.source="a \\"b\\" 7"'
    assert setting("camera.source", "2024") == 'camera.source="2024"'
    assert setting("camera.source", "Straße") == 'camera.source="Straße"'


def test_scale_and_endpoints_reach_the_services() -> None:
    services = planned(
        LaunchRequest(scale=["detector=2"], port=7555, host="0.0.0.0", environment={})
    )
    assert services["detector"].instances == ("detector-1", "detector-2")
    assert services["detector"].environment["PEOPLE4D_CONNECT"] == "tcp/127.0.0.1:7555"
    assert services["detector"].environment["PEOPLE4D_LISTEN"] == "tcp/127.0.0.1:0"
    assert services["router"].environment["PEOPLE4D_LISTEN"] == "tcp/0.0.0.0:7555"


def test_a_report_adds_its_service_and_plays_the_source_once(tmp_path: Path) -> None:
    services = planned(LaunchRequest(report=tmp_path, environment={}))
    assert services["report"].command[-1] == setting("folder", str(tmp_path))
    assert services["camera"].restart == "no"
    assert "report" not in planned(LaunchRequest(environment={}))
    assert planned(LaunchRequest(environment={}))["camera"].restart == "on-failure"


def test_gait_runs_only_with_its_option() -> None:
    assert "gait" not in planned(LaunchRequest(environment={}))
    services = planned(
        LaunchRequest(profiles=["gait"], settings=["gait.people_max=2"], environment={})
    )
    assert services["gait"].command[-2:] == ("--set", "people_max=2")
    assert "gait" in [one.service for one in services["camera"].depends_on]


@pytest.mark.slow
def test_visual_odometry_runs_only_with_its_option() -> None:
    assert "visual_odometry" not in planned(LaunchRequest(environment={}))
    settings = ["visual_odometry.planar=false"]
    services = planned(
        LaunchRequest(profiles=["visual_odometry"], settings=settings, environment={})
    )
    assert services["visual_odometry"].command[-2:] == ("--set", "planar=false")
    assert "visual_odometry" in [one.service for one in services["camera"].depends_on]


@pytest.mark.parametrize(
    ("launch", "message"),
    [
        (LaunchRequest(settings=["singer.field=1"]), "unknown service 'singer'"),
        (LaunchRequest(settings=["gait.people_max=2"]), "gait is not enabled. Add --gait"),
        (LaunchRequest(scale=["gait=2"], profiles=["gait"]), "gait runs once"),
        (LaunchRequest(settings=["tracker=1"]), "Write service.field=value"),
        (LaunchRequest(settings=["tracker.field"]), "Write service.field=value"),
        *(
            (LaunchRequest(scale=[f"{name}=0"]), f"no people are tracked without {name}")
            for name in ("router", "detector", "tracker")
        ),
        (LaunchRequest(scale=["detector"]), "Write service=number"),
        (LaunchRequest(scale=["singer=2"]), "unknown service 'singer'"),
        (LaunchRequest(config=Path("none.toml")), "none.toml does not exist"),
    ],
)
def test_bad_launch_request_is_rejected(launch: LaunchRequest, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        plan(launch)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ([], "no camera is named.*--source"),
        (["camera.source='none.bag'"], "source 'none.bag' does not exist"),
        (["camera.source='a.txt'"], "a.txt is not a known kind of recording"),
        (["camera.source='a:B'", "camera.transforms='b.toml'"], "b.toml does not exist"),
        (["camera.source='a:B'", "camera.transforms='a.txt'"], "a.txt: .*line 1"),
        (["camera.source='a:B'", "detector.model='mine'"], "model 'mine' is unknown"),
        (["camera.source='a:B'", "detector.model='none.onnx'"], "none.onnx does not exist"),
        (["camera.source='a:B'", "detector.score_min=2"], "score_min: expected"),
        (["camera.source='a:B'", "detector.scoremin=0.2"], "scoremin"),
        (["camera.source='a:B'", "tracker.tracker='foo'"], "tracker 'foo' is unknown"),
        (["camera.source='a:B'", "reid.embedder='face'"], "embedder 'face' is unknown"),
    ],
)
def test_wrong_settings_are_rejected_before_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, settings: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.txt").write_text("no recording")
    launch = LaunchRequest(settings=settings, environment={})
    with pytest.raises(People4dError, match=message):
        check_settings(plan(launch), launch)


def test_unwritable_report_folder_is_rejected(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    launch = LaunchRequest(
        settings=["camera.source='a:B'"], report=tmp_path / "file" / "out", environment={}
    )
    with pytest.raises(ConfigError, match="cannot be written"):
        check_settings(plan(launch), launch)


def test_source_may_come_from_any_setting(tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text('[camera]\nsource = "my.camera:Camera"\n')
    for launch in (
        LaunchRequest(environment={"PEOPLE4D_CAMERA_SOURCE": "my.camera:Camera"}),
        LaunchRequest(config=file, environment={}),
    ):
        check_settings(plan(launch), launch)


def test_transforms_without_the_named_camera_are_rejected(tmp_path: Path) -> None:
    file = tmp_path / "transforms.toml"
    file.write_text('reference = "c1"\ncameras = {}\n')
    settings = ["camera.source='a:B'", f"camera.transforms='{file}'"]
    launch = LaunchRequest(settings=settings, environment={})
    check_settings(plan(launch), launch)
    launch = LaunchRequest(settings=[*settings, "camera.camera='c2'"], environment={})
    with pytest.raises(SourceError, match="has no camera c2"):
        check_settings(plan(launch), launch)
