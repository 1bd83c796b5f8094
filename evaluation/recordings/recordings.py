"""Recordings with ground truth: existing files, or scenarios of the virtual lab, rendered once."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import lab
from common.io.recording import open_recording
from evaluation.cache import key_of
from evaluation.pool import OnProgress
from lab.catalogue import PREFIX, is_scenario, load_scenario, scenario_names, split_seed
from lab.depth.metadata import read_metadata
from lab.output.chunks import digest_of
from lab.output.render import Outputs, render
from lab.output.sequence import Fidelity, RenderJob
from lab.scenario import Scenario
from people4d.errors import ConfigError, SourceError
from services.camera.sources import kind_of

LAB_CODE = Path(lab.__file__).parent


@dataclass(frozen=True)
class EvaluationRecording:
    """One recording with ground truth."""

    name: str  # unique, and valid as the name of a file
    scenario: str  # common name of repetitions with other seeds
    path: Path  # recording, bag or folder
    seed: int | None = None  # seed of the simulation; None: no simulation, or unknown
    # Scenario of the virtual lab; None: not simulated
    simulation: Scenario | None = field(default=None, repr=False)
    # Rendering job; None for an existing file
    job: RenderJob | None = field(default=None, repr=False)
    annotations: Path | None = None  # file of annotations in place of other truth

    @property
    def truth_file(self) -> Path:
        """File with the truth of each frame, if it was rendered."""
        return self.path.with_suffix(".truth.npz")


def plan_recordings(
    names: Sequence[str], seeds: Sequence[int], fidelity: Fidelity, cache: Path
) -> list[EvaluationRecording]:
    """Return recordings and scenarios (lab:SCENARIO or lab:SCENARIO@SEED), in the order given.

    Scenarios that name no seed are rendered to the cache for each of `seeds`, or their own.
    ConfigError if there is no such scenario, or two recordings have the same name; SourceError if
    there is no such recording.
    """
    recordings = []
    for name in names:
        recordings += (
            _scenarios(name, seeds, fidelity, cache) if is_scenario(name) else [_recorded(name)]
        )
    counts = Counter(recording.name for recording in recordings)
    twice = sorted(name for name, count in counts.items() if count > 1)
    if twice:
        raise ConfigError(f"recordings: {', '.join(twice)} is repeated", "Rename one of them.")
    return recordings


def render_recording(recording: EvaluationRecording, jobs: int, on_progress: OnProgress) -> None:
    """Render a scenario with some processes, unless it is cached; SourceError if it cannot be."""
    if recording.job is None or recording.path.exists():
        return
    truth = recording.truth_file if recording.job.truth_per_frame else None
    if truth:
        truth.unlink(missing_ok=True)  # file of an interrupted run
    render(recording.job, Outputs(recording=recording.path, truth=truth), jobs, on_progress)


def _scenarios(
    name: str, seeds: Sequence[int], fidelity: Fidelity, cache: Path
) -> list[EvaluationRecording]:
    scenario, own = split_seed(name.removeprefix(PREFIX))
    usual = load_scenario(scenario)
    drawn = fidelity != "geometry"
    recordings = []
    for seed in [own] if own is not None else list(seeds) or [usual.seed]:
        plan = load_scenario(scenario, seed)
        job = RenderJob(scenario=plan, seed=seed, fidelity=fidelity, truth_per_frame=drawn)
        unique = f"{plan.name}@{seed}"
        key = key_of(job, digest_of(LAB_CODE))
        path = cache / "scenes" / f"{unique}-{fidelity}-{key[:16]}.mcap"
        recordings.append(EvaluationRecording(unique, plan.name, path, seed, plan, job))
    return recordings


def _recorded(name: str) -> EvaluationRecording:
    path, kind = Path(name), kind_of(name)
    if kind in ("plugin", "lab"):
        raise SourceError(f"{name} is not a recording", "Give a file, a folder or lab:SCENARIO.")
    note = read_metadata(open_recording(path)) if kind == "recording" else None
    stem = path.name if path.is_dir() else path.stem
    if note is None:
        return EvaluationRecording(stem, stem, path)
    simulation = load_scenario(note.scenario) if note.scenario in scenario_names() else None
    return EvaluationRecording(stem, note.scenario, path, note.seed, simulation)
