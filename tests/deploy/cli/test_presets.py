"""Presets: all load, agree with docs/method.md, and are overridden by flags."""

from pathlib import Path
from typing import TypeVar

import msgspec
import pytest
from typer.testing import CliRunner

from common.config import load
from deploy.cli import app
from deploy.launcher.plan import CONFIG_FILE, LaunchRequest, plan
from people4d.errors import ConfigError
from services.detector.config import DetectorConfig
from services.detector.orientation.separate import BASELINE_MIN_M, HIP_RATIO_MAX, SHOULDER_RATIO_MAX
from services.gait.config import PUBLISHED_TAU, GaitConfig
from services.presets import DEFAULTS, FOLDER, PRESETS, preset_settings
from services.reid.config import ReidConfig
from services.tracker.config import ImageSortConfig, TrackerConfig
from services.tracker.strongsort3d.config import IdentityConfig, StrongSort3dConfig

ROOT = Path(__file__).parents[3]
T = TypeVar("T", bound=msgspec.Struct)


def config_of(kind: type[T], service: str, preset: str) -> T:
    """Return the configuration of a service under `people4d up --preset`."""
    texts = [text.partition(".") for text in preset_settings(preset)]
    overrides = [field for name, _, field in texts if name == service]
    return load(kind, service, CONFIG_FILE, overrides, {})


def test_each_preset_has_its_file_and_each_file_its_line() -> None:
    assert {file.stem for file in FOLDER.glob("*.toml")} == PRESETS.keys() - {DEFAULTS}


@pytest.mark.parametrize("name", PRESETS)
def test_each_preset_loads_into_every_service(name: str) -> None:
    services = {text.partition(".")[0] for text in preset_settings(name)}
    assert services <= ({"gait"} if name.startswith("gait-") else {"detector", "reid", "tracker"})
    config_of(DetectorConfig, "detector", name)
    config_of(ReidConfig, "reid", name)
    config_of(TrackerConfig, "tracker", name)


@pytest.mark.parametrize("feature", ["spin", "geodesic"])
def test_single_features_of_gait_are_sections_8_1_and_8_3(feature: str) -> None:
    cascade = config_of(GaitConfig, "gait", f"gait-{feature}").cascade
    assert (cascade.depth.feature, cascade.depth.particles) == (feature, 60)
    colour = cascade.colour
    assert (colour.weights, colour.sigma, colour.sampling) == ("distance", 1.0, "hierarchical")
    assert colour.tau == PUBLISHED_TAU


@pytest.mark.parametrize("suffix", ["", "-movenet"])
def test_seg_sort_is_section_4(suffix: str) -> None:
    detector = config_of(DetectorConfig, "detector", f"seg-sort{suffix}")
    tracker = config_of(TrackerConfig, "tracker", f"seg-sort{suffix}")
    assert detector.position == ("grown" if suffix else "mask")
    assert (tracker.tracker, tracker.yaw, tracker.yaw_speed_min_mps) == ("sort3d", "velocity", 0.0)
    assert not tracker.publish_lost
    sort = tracker.sort3d
    assert (sort.min_hits, sort.distance_gate_floor_m) == (3, 0.0)


@pytest.mark.parametrize("suffix", ["", "-movenet"])
@pytest.mark.parametrize("method", ["seg-strongsort", "pose-strongsort"])
def test_the_other_methods_track_by_sections_3_and_5(method: str, suffix: str) -> None:
    tracker = config_of(TrackerConfig, "tracker", method + suffix)
    assert tracker.tracker == "strongsort3d"
    assert not tracker.publish_lost
    strong = tracker.strongsort3d
    assert strong == StrongSort3dConfig(
        n_init=3,
        a_max=30,
        lifetime="streak",
        sigma_acceleration_mps2=0.5,
        sigma_measurement_m=0.5,
        noise="constant",
        visibility=False,
        identity=IdentityConfig(enabled=False),
        standing_model=False,
    )
    assert tracker.yaw == ("kalman" if method.startswith("pose") else "velocity")
    reid = config_of(ReidConfig, "reid", method + suffix)
    assert reid.embedder == ("histogram" if suffix else "osnet")
    assert config_of(DetectorConfig, "detector", method + suffix).crops


def test_the_third_method_measures_by_sections_2_and_6() -> None:
    detector = config_of(DetectorConfig, "detector", "pose-strongsort")
    assert detector.model == "yolov8n-pose"
    assert detector.position == "keypoints"
    assert detector.confidence_for(detector.model) == 0.6
    assert detector.orientation.method == "separate"
    assert (BASELINE_MIN_M, SHOULDER_RATIO_MAX, HIP_RATIO_MAX) == (0.1, 0.90, 0.66)
    twin = config_of(DetectorConfig, "detector", "pose-strongsort-movenet")
    assert twin.confidence_for(twin.model) == 0.3


def test_the_odometry_paper_s_variants_differ_in_two_settings() -> None:
    names = ("image-sort", "image-sort-dynamic", "image-sort-odom", "image-sort-odom-dynamic")
    found = [config_of(TrackerConfig, "tracker", name) for name in names]
    assert {config.tracker for config in found} == {"image_sort"}
    assert [(c.image_sort.ego_motion, c.image_sort.lifetime) for c in found] == [
        ("none", "fixed"),
        ("none", "dynamic"),
        ("odometry", "fixed"),
        ("odometry", "dynamic"),
    ]
    assert found[0].image_sort == ImageSortConfig()  # SORT as published
    assert not any(config.publish_lost for config in found)


def test_a_later_setting_wins_over_the_preset() -> None:
    settings = [*preset_settings("seg-sort"), "detector.model=mine.onnx"]
    (detector,) = (
        s for s in plan(LaunchRequest(settings=settings, environment={})) if s.name == "detector"
    )
    arguments = detector.command[3:]
    overrides = [value for flag, value in zip(arguments[::2], arguments[1::2], strict=True) if flag]
    assert load(DetectorConfig, "detector", None, overrides, {}).model == "mine.onnx"


def test_own_file_extends_a_preset(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text(
        'extends = "seg-sort-movenet"\n[tracker.sort3d]\nt_lost = 5\n[reid]\nembedder = "a b"\n'
    )
    settings = preset_settings(str(mine))
    assert settings[-1] == 'reid.embedder="a b"'
    assert "tracker.sort3d.t_lost=5" in settings
    assert 'detector.model="movenet-multipose"' in settings  # of seg-sort-movenet, not seg-sort
    assert sum(text.startswith("detector.model=") for text in settings) == 1
    assert preset_settings("") == []


def test_a_preset_extends_one_of_its_own_folder_wherever_it_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "base.toml").write_text("[tracker.sort3d]\nt_lost = 5\n")
    (tmp_path / "mine.toml").write_text('extends = "base.toml"\n')
    monkeypatch.chdir("/")
    assert preset_settings(str(tmp_path / "mine.toml")) == ["tracker.sort3d.t_lost=5"]


def test_infinity_and_booleans_keep_their_type(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("[tracker]\npublish_lost = false\nimage_sort.r = inf\n")
    settings = preset_settings(str(tmp_path / "mine.toml"))
    assert settings == ["tracker.publish_lost=false", "tracker.image_sort.r=inf"]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('extends = "mine.toml"', "extends itself"),
        ('extends = "seg-sorted"', "unknown preset 'seg-sorted'. Did you mean seg-sort?"),
        ("detector = 3", "detector is not a table"),
        ("extends = 3", "extends is not a name"),
        ('extends = "../other.toml"', "leads out of the folder"),
        ('extends = "/etc/other.toml"', "leads out of the folder"),
        ('extends = "link.toml"', "leads out of the folder"),
        ('[camera]\nsource = "/dev/video0"', "sets camera, which is not part of a method"),
        ('[report]\nfolder = "/etc"', "sets report, which is not part of a method"),
        ('[detector]\n"model=x\\ncommand" = 1', "detector has no field 'model=x"),
        ("[detector]\nmodel = 2020-01-01", "is not a number, text or list"),
        ("[detector" + ".a" * 3000 + "]", "has no field 'a'"),
        ("a = " + "[" * 5000, "is not TOML: lists or tables are nested too deeply"),
        ("[detector", "is not TOML"),
    ],
)
def test_bad_files_are_rejected(
    text: str, problem: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "other.toml").touch()
    (tmp_path / "presets").mkdir()
    monkeypatch.chdir(tmp_path / "presets")
    Path("link.toml").symlink_to("../other.toml")
    Path("mine.toml").write_text(text)
    with pytest.raises(ConfigError, match=problem):
        preset_settings("mine.toml")


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("nonsense", "unknown preset 'nonsense'. There are best,"),
        ("none.toml", "none.toml cannot be read: No such file"),
    ],
)
@pytest.mark.parametrize("command", ["up", "demo"])
def test_unknown_preset_is_reported(command: str, name: str, problem: str) -> None:
    result = CliRunner().invoke(app, [command, "--preset", name])
    assert result.exit_code == 1
    assert problem in result.stderr


@pytest.mark.parametrize("command", ["up", "demo"])
def test_help_lists_the_presets(command: str) -> None:
    text = CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "300"}).stdout
    assert all(name in text for name in PRESETS)


def test_best_is_the_defaults_by_name_and_as_a_base(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text('extends = "best"\n[tracker]\nmax_lost_s = 3.0\n')
    assert preset_settings("best") == []
    assert preset_settings(str(mine)) == ["tracker.max_lost_s=3.0"]
