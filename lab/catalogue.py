"""Scenarios by name: scenarios that ship, files of the user, and random scenes."""

import re
from pathlib import Path

import msgspec

from common.config import setting
from common.io.files import read_toml
from lab.random_scenario import is_random, random_scenario
from lab.scenario import Scenario
from people4d.errors import ConfigError
from people4d.validation import explain

FOLDER = Path(__file__).parent / "scenarios"
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")
PREFIX = "lab:"
TRUTH = "lab.source:LabTruth"


def scenario_names() -> list[str]:
    """Return the names of the scenarios that ship."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load_scenario(name: str, seed: int | None = None) -> Scenario:
    """Read a scenario by its name or the path of its file, or draw a random scene.

    ConfigError if there is no such scenario, or it cannot be read.

    Args:
        name: Name, path, or random?OPTION=VALUE&..., see `lab.random_options.RandomScene`.
        seed: Seed of a random scene, in place of the seed in its name; others do not depend on it.
    """
    if is_random(name):
        return random_scenario(name, seed)
    path = FOLDER / f"{name}.toml" if NAME.fullmatch(name) else Path(name)
    data: dict[str, object] = {}
    try:
        data = {**read_toml(path), "name": path.stem}
        return msgspec.convert(data, Scenario)
    except FileNotFoundError as error:
        names = ", ".join(scenario_names())
        raise ConfigError(f"unknown scenario {name}", f"There are {names}.") from error
    except OSError as error:
        raise ConfigError(f"scenario {path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        hint = f"Compare it with those that ship, in {FOLDER}."
        problem = explain(error, data, "").lstrip(".: ")
        raise ConfigError(f"scenario {path}: {problem}", hint) from error


def split_seed(name: str) -> tuple[str, int | None]:
    """Split a scenario from its seed, NAME@SEED; ConfigError if the text after @ is no seed."""
    scenario, separator, seed = name.rpartition("@")
    if not separator:
        return name, None
    if not seed.isdecimal():
        raise ConfigError(f"scenario {name}: expected a whole number after @, got {seed!r}")
    return scenario, int(seed)


def is_scenario(source: str) -> bool:
    """Check that a source is a scenario."""
    return source.startswith(PREFIX)


def resolve(source: str) -> str:
    """Return the source with an absolute path, for other folders; ConfigError if there is none."""
    name, _ = split_seed(source.removeprefix(PREFIX))
    load_scenario(name)
    if is_random(name) or NAME.fullmatch(name):
        return source
    return PREFIX + str(Path(source.removeprefix(PREFIX)).absolute())


def truth_settings(truth: str, loop: bool) -> list[str]:
    """Return the settings of the ground-truth bridge for a scenario, played once or in a loop."""
    settings = [setting("gt_bridge.source", TRUTH)]
    if loop:
        name, _ = split_seed(truth.removeprefix(PREFIX))
        scenario = load_scenario(name)
        # A camera in a loop adds the duration of its frames to the stamps.
        frames = round(scenario.duration_s * scenario.camera.fps)
        settings.append(f"gt_bridge.loop_s={frames / scenario.camera.fps}")
    return settings
