"""Scenarios of the virtual lab as sources: lab:NAME, lab:FILE.toml, either with @SEED."""

from pathlib import Path

from common.config import setting
from lab.scenario import NAME, Scenario, load_scenario, split_seed

PREFIX = "lab:"
TRUTH = "lab.truth:LabTruth"


def is_scenario(source: str) -> bool:
    """Tell whether a source is a scenario."""
    return source.startswith(PREFIX)


def resolve(source: str) -> str:
    """Return the source with an absolute path, since services run in another folder.

    Raises:
        ConfigError: There is no such scenario; told before anything is started.
    """
    name, _ = split_seed(source.removeprefix(PREFIX))
    load_scenario(name)
    if NAME.fullmatch(name):
        return source
    return PREFIX + str(Path(source.removeprefix(PREFIX)).absolute())


def truth_settings(truth: str, loop: bool) -> list[str]:
    """Return the settings with which the ground-truth bridge tells what is true in a scenario.

    Args:
        truth: The scenario.
        loop: It is played again and again.
    """
    settings = [setting("gt_bridge.source", TRUTH)]
    if loop:
        name, _ = split_seed(truth.removeprefix(PREFIX))
        settings.append(f"gt_bridge.loop_s={round_s(load_scenario(name))}")
    return settings


def round_s(scenario: Scenario) -> float:
    """Return what a camera that plays a scenario again and again adds to its stamps [s]."""
    return round(scenario.duration_s * scenario.camera.fps) / scenario.camera.fps
