"""What methods are judged on: recordings as they are, and scenarios filmed once."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

import lab
from common.io.recording import open_recording
from evaluation.cache import key_of
from lab.depth.metadata import SimulationMetadata, read_metadata
from lab.output.chunks import digest_of
from lab.output.render import Outputs, render
from lab.output.sequence import Fidelity, RenderJob
from lab.scenario import PREFIX, Scenario, is_scenario, load_scenario, scenario_names, split_seed
from people4d.errors import ConfigError, SourceError
from services.camera.sources import kind_of

LAB_CODE = Path(lab.__file__).parent

OnProgress = Callable[[str, float], object]


@dataclass(frozen=True)
class EvaluationRecording:
    """One recording with what is true in it.

    Args:
        name: Unique, fit for the name of a file.
        scenario: Name that repetitions with other seeds share.
        path: Recording, bag or folder.
        seed: Of the simulation; None: it is none, or the seed is not known.
        filmed: The scenario; None: the recording is not of the virtual lab.
        order: How it is filmed; None: it is there already.
    """

    name: str
    scenario: str
    path: Path
    seed: int | None = None
    filmed: Scenario | None = field(default=None, repr=False)
    order: RenderJob | None = field(default=None, repr=False)

    @property
    def truth_file(self) -> Path:
        """Where a rendering has the truth about each frame, if it was asked for."""
        return self.path.with_suffix(".truth.npz")


def plan_recordings(
    names: Sequence[str], seeds: Sequence[int], speed: Fidelity, cache: Path
) -> list[EvaluationRecording]:
    """Return the takes of recordings and scenarios, in the order given.

    Args:
        names: Recordings, ROS bags, folders, lab:SCENARIO or lab:SCENARIO@SEED.
        seeds: Of every scenario that names none; empty: its own.
        speed: How scenarios are filmed.
        cache: Folder that filmed scenarios are kept in.

    Raises:
        ConfigError: There is no such scenario, or two takes have one name.
        SourceError: There is no such recording.
    """
    takes = []
    for name in names:
        takes += _scenes(name, seeds, speed, cache) if is_scenario(name) else [_recorded(name)]
    twice = sorted({t.name for t in takes if [other.name for other in takes].count(t.name) > 1})
    if twice:
        raise ConfigError(f"recordings: {', '.join(twice)} comes twice", "Rename one of them.")
    return takes


def render_recording(take: EvaluationRecording, jobs: int, report: OnProgress) -> None:
    """Render a scenario, unless it was rendered before.

    Args:
        take: What is wanted.
        jobs: Processes that draw at once.
        report: Called with what is being done and the share of it that is done.

    Raises:
        SourceError: The cache cannot be written.
    """
    if take.order is None or take.path.exists():
        return
    truth = take.truth_file if take.order.truth_per_frame else None
    if truth:
        truth.unlink(missing_ok=True)  # left by an interrupted run
    render(take.order, Outputs(recording=take.path, truth=truth), jobs, report)


def _scenes(
    name: str, seeds: Sequence[int], speed: Fidelity, cache: Path
) -> list[EvaluationRecording]:
    scenario, own = split_seed(name.removeprefix(PREFIX))
    plan = load_scenario(scenario)
    wanted = [own] if own is not None else list(seeds) or [plan.seed]
    return [_scene(plan, seed, speed, cache) for seed in wanted]


def _scene(plan: Scenario, seed: int, speed: Fidelity, cache: Path) -> EvaluationRecording:
    order = RenderJob(scenario=plan, seed=seed, fidelity=speed, truth_per_frame=speed != "geometry")
    name = f"{plan.name}@{seed}"
    key = key_of(msgspec.to_builtins(order), digest_of(LAB_CODE))
    path = cache / "scenes" / f"{name}-{speed}-{key[:16]}.mcap"
    return EvaluationRecording(name, plan.name, path, seed, plan, order)


def _recorded(name: str) -> EvaluationRecording:
    path, kind = Path(name), kind_of(name)
    if kind in ("plugin", "lab"):
        raise SourceError(f"{name} is no recording", "Give a file, a folder or lab:SCENARIO.")
    note = read_metadata(open_recording(path)) if kind == "recording" else None
    stem = path.name if path.is_dir() else path.stem
    if note is None:
        return EvaluationRecording(stem, stem, path)
    return EvaluationRecording(stem, note.scenario, path, note.seed, _scenario_of(note))


def _scenario_of(note: SimulationMetadata) -> Scenario | None:
    return load_scenario(note.scenario) if note.scenario in scenario_names() else None
