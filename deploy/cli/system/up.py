"""Command `people4d up`."""

import os
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from common.config import setting
from deploy.cli.options import NETWORK, PRESET_HELP, NewRobot, ReadyTimeout, Settings
from deploy.cli.system.demo import DEMO
from deploy.cli.system.launch import LOCKSTEP_WAITS, SIMULATED, START_TIMEOUT_S, launch
from deploy.launcher.plan import CAMERA, COMPOSE_FILE, HOST, PORT, REPORT, LaunchRequest
from lab import catalogue as scenarios
from people4d.errors import ConfigError
from services.camera.sources import PLUGIN, ROS2, named_cameras
from services.gait.config import POINTS_MODEL
from services.gt_bridge.sources.registry import is_live
from services.presets import preset_settings

PUSHED = "push"  # source of frames from programs, see people4d_robot.Camera
# Mount of a camera without a pose in its source: the base, not the map.
ON_BASE = f"{CAMERA}.mount_parent=base_link"
# Panels of the help, with NETWORK
SOURCE, METHODS, EXTRAS = "Source", "Methods", "Extras"


def _option(help_: str, panel: str, *names: str, **more: Any) -> Any:
    return typer.Option(*names, help=help_, rich_help_panel=panel, **more)


def up(
    source_: Annotated[
        str, typer.Argument(metavar="SOURCE", help="The source, as with --source.")
    ] = "",
    source: Annotated[
        str,
        _option(
            "Recording, ROS bag, image folder, demo, lab:SCENARIO, ros2:/camera or "
            "ros2:realsense (live), realsense, orbbec, oak or module:Class of a camera, or push: "
            "frames of a program.",
            SOURCE,
        ),
    ] = "",
    truth: Annotated[
        str,
        _option(
            "Ground truth: recording, bag, CSV, MOT text, gt.npz, or ros2:/TOPIC (live).", SOURCE
        ),
    ] = "",
    transforms: Annotated[
        Path | None, _option("Poses of cameras, a file of people4d calibrate.", SOURCE)
    ] = None,
    playback: Annotated[
        Literal["recorded", "lockstep"] | None,
        _option("At the recorded rate, or as fast as possible without losing a frame.", SOURCE),
    ] = None,
    loop: Annotated[bool, _option("Play the source repeatedly.", SOURCE, "--loop")] = False,
    preset: Annotated[str, _option(PRESET_HELP, METHODS)] = "",
    model: Annotated[str, _option("Detection model, see people4d models.", METHODS)] = "",
    tracker: Annotated[str, _option("Tracking method.", METHODS)] = "",
    embedder: Annotated[str, _option("Appearance model.", METHODS)] = "",
    visual_odometry: Annotated[
        bool, _option("Estimate the base's motion from images.", METHODS, "--visual-odometry")
    ] = False,
    gait: Annotated[
        bool, _option("Track heads, hands and feet, and measure gait.", EXTRAS, "--gait")
    ] = False,
    predict: Annotated[
        bool, _option("Predict paths of people, and find groups.", EXTRAS, "--predict")
    ] = False,
    skeletons: Annotated[
        bool, _option("Estimate the joints of each person in 3D.", EXTRAS, "--skeletons")
    ] = False,
    target: Annotated[
        bool, _option("Keep track of one chosen person; see follow.", EXTRAS, "--target")
    ] = False,
    events: Annotated[
        bool, _option("Publish events and zones; --dashboard does, too.", EXTRAS, "--events")
    ] = False,
    dashboard: Annotated[
        bool, _option("Serve a page that shows everything; see open.", EXTRAS, "--dashboard")
    ] = False,
    report: Annotated[
        Path | None,
        _option("Run to the end of the source, write a report to this folder, stop.", EXTRAS),
    ] = None,
    ros2: Annotated[
        Literal["zenoh", "dds"] | None,
        _option("Publish to ROS 2: nodes on rmw_zenoh or DDS.", NETWORK),
    ] = None,
    robot: NewRobot = "robot",
    host: Annotated[
        str, _option("Address of the router; 0.0.0.0 lets other machines connect.", NETWORK)
    ] = HOST,
    port: Annotated[int, _option("Port of the router.", NETWORK, min=1, max=65535)] = PORT,
    privacy: Annotated[
        bool, _option("Images stay on this host; tracks are still published.", NETWORK, "--privacy")
    ] = False,
    set_: Settings = [],  # noqa: B006 (typer copies it)
    config: Annotated[
        Path | None, typer.Option(help="TOML file with a table for each service.")
    ] = None,
    scale: Annotated[list[str], typer.Option(metavar="SERVICE=N", help="Number of replicas.")] = [],  # noqa: B006
    together: Annotated[
        str,
        typer.Option(
            metavar="SERVICE,SERVICE,...",
            help="Services in one process, joined in memory: detector,reid,tracker.",
        ),
    ] = "",
    profile: Annotated[
        list[str], typer.Option(help="Profile of the compose file; its services run, too.")
    ] = [],  # noqa: B006
    compose: Annotated[
        Path, typer.Option(help="Another compose file.", show_default=False)
    ] = COMPOSE_FILE,
    detach: Annotated[
        bool, typer.Option("--detach", "-d", help="Return once all services are ready.")
    ] = False,
    timeout_s: ReadyTimeout = START_TIMEOUT_S,
) -> None:
    """Start the system on this machine and supervise it; Ctrl-C stops it.

    Settings come from the configuration file, then PEOPLE4D_<SERVICE>_<FIELD> in the environment,
    then the preset, then the other options.
    """
    if source and source_:
        raise typer.BadParameter(f"two sources: {source_} and --source {source}")
    source = source or source_
    if privacy:  # environment of the router and of all processes
        os.environ |= {"PEOPLE4D_PRIVACY": "on", "PEOPLE4D_DASHBOARD_PRIVACY": "true"}
    if detach and report:
        raise typer.BadParameter("a report needs the terminal until it is written; leave out -d")
    if scenarios.is_scenario(source) or _is_demo(source):
        truth = truth or source
        set_ = [setting(f"{REPORT}.note", SIMULATED), *set_] if report else set_
    texts = {
        f"{CAMERA}.source": "" if source == PUSHED else _resolve(source),
        "gt_bridge.truth": truth if is_live(truth) else _resolve(truth),
        "detector.model": model,
        "tracker.tracker": tracker,
        "reid.embedder": embedder,
        f"{REPORT}.truth": truth if report else "",
        f"{CAMERA}.playback": playback or "",
        f"{CAMERA}.transforms": str(transforms.absolute()) if transforms else "",
        "ros2_bridge.ros2.transport": ros2 or "",
    }
    settings = _points_model(config) if gait else []
    settings += preset_settings(preset)
    settings += [setting(name, text) for name, text in texts.items() if text]
    if scenarios.is_scenario(truth):
        settings += scenarios.truth_settings(truth, loop)
    elif loop and source and truth and not is_live(truth):
        from services.camera.playback import loop_period_s  # noqa: PLC0415 (loads compiled code)

        settings.append(f"gt_bridge.loop_s={loop_period_s(_resolve(source))!r}")
    settings += [f"{CAMERA}.loop=true"] if loop else []
    settings += LOCKSTEP_WAITS if playback == "lockstep" else ()
    settings += [ON_BASE] if visual_odometry else []
    asked = {
        "gait": gait,
        "visual_odometry": visual_odometry,
        "predictor": predict,
        "skeleton": skeletons,
        "target": target,
        "ros2_bridge": bool(ros2),
        "events": events or dashboard,
        "dashboard": dashboard,
    }
    profiles = [*profile, *(name for name, wanted in asked.items() if wanted)]
    request = LaunchRequest(
        robot=robot,
        host=host,
        port=port,
        config=config,
        compose=compose,
        settings=[*settings, *set_],
        scale=[*scale, f"{CAMERA}=0"] if source == PUSHED else scale,
        report=report,
        profiles=profiles,
        together=[name for name in together.split(",") if name],
    )
    launch(request, timeout_s, detach)


def _points_model(config: Path | None) -> list[str]:
    """Return the setting of the model that `people4d gait` uses; empty if the user chose models."""
    chosen = config is not None or "PEOPLE4D_DETECTOR_MODEL" in os.environ
    return [] if chosen else [setting("detector.model", POINTS_MODEL)]


def _is_demo(source: str) -> bool:
    return source == "demo" and not Path(source).exists()


def _resolve(source: str) -> str:
    """Return an absolute path; scenarios and plug-in cameras do not change."""
    if scenarios.is_scenario(source):
        return scenarios.resolve(source)
    if _is_demo(source):
        return str(DEMO)
    path = Path(source)
    if source and path.exists():
        return str(path.absolute())
    named = PLUGIN.fullmatch(source) or ROS2.fullmatch(source) or source in named_cameras()
    if source and not named:
        raise ConfigError(f"source {source} does not exist", "Check the path.")
    return source
