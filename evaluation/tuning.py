"""Search of a tracker's settings on a recording with ground truth, with cross-validation.

The recording is divided into contiguous parts (`part_sums`), which form FOLDS. For each fold the
settings are searched on the other folds and scored on this one; these scores give the gain over
the given settings with its interval. A last search on all folds gives the result. Settings that
lower IDF1 on the shipped recording are not chosen.
"""

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec
import numpy as np

from common.metrics.intervals import pool
from common.metrics.record import I64
from evaluation.annotations.marks import read_annotations
from evaluation.compare import ComparedFigure, compare_sums
from evaluation.methods import Method
from evaluation.pool import OnProgress, Pool
from evaluation.recordings.recordings import EvaluationRecording
from evaluation.recordings.rendered import HELD_OUT
from evaluation.report.parts import FIGURES, part_sums
from evaluation.run.preparation import EvaluationPlan, check_models, render_all, runs_of
from evaluation.run.run import EvaluationRun, execute
from people4d.errors import ConfigError, SourceError
from people4d.messages import F64
from services.camera.config import CameraConfig
from services.presets import preset_settings
from services.tracker.config import TrackerConfig

FOLDS = 4
IDF1 = 0  # index of the searched figure
ALL = slice(None)  # all parts of a recording
CANDIDATES_MIN = 2  # minimum number of settings in a search: the given ones and others

Settings = dict[str, float]  # values by path in the configuration of the tracker


@dataclass(frozen=True)
class SearchedSetting:
    """Range of a setting."""

    path: str  # path in the configuration of the tracker
    low: float
    high: float
    integer: bool = False  # True: an integer


SEARCHED = {  # settings by tracker
    "strongsort3d": (
        SearchedSetting("strongsort3d.distance_max_m", 0.3, 2.0),
        SearchedSetting("strongsort3d.n_init", 1, 6, integer=True),
        SearchedSetting("strongsort3d.a_max", 5, 150, integer=True),
    ),
    "sort3d": (
        SearchedSetting("sort3d.distance_gate_floor_m", 0.2, 2.0),
        SearchedSetting("sort3d.min_hits", 1, 6, integer=True),
        SearchedSetting("sort3d.t_lost", 1, 150, integer=True),
    ),
    "image_sort": (
        SearchedSetting("image_sort.min_hits", 1, 6, integer=True),
        SearchedSetting("image_sort.t_lost", 1, 150, integer=True),
    ),
}


@dataclass(frozen=True)
class TuningBudget:
    """End of each of the FOLDS + 1 searches."""

    minutes: float  # duration of all searches [min]
    candidates: int = 0  # number of settings in each search, in place of a duration; 0: by duration
    seed: int = 1

    def __post_init__(self) -> None:
        """Check the budget."""
        if not (np.isfinite(self.minutes) and self.minutes > 0):
            raise ConfigError(f"--minutes: expected more than 0, got {self.minutes:g}")
        if self.candidates and self.candidates < CANDIDATES_MIN:
            raise ConfigError(
                f"--candidates: expected {CANDIDATES_MIN} or more, got {self.candidates}"
            )


@dataclass(frozen=True)
class TuningResult:
    """Settings found, and their gain in parts on which they were not searched."""

    settings: Settings
    gain: ComparedFigure  # gain in IDF1
    worse: tuple[ComparedFigure, ...]  # other figures that are worse beyond their interval
    candidates: int  # number of settings in the last search

    @property
    def is_better(self) -> bool:
        """True if IDF1 is better beyond its interval, and no other figure worse."""
        return self.gain.is_better and not self.worse and bool(self.settings)


def check_tuning(recording: EvaluationRecording, method: Method) -> None:
    """Check that settings of a method may be searched on a recording.

    ConfigError if the recording is in the test split, or the tracker has no settings to search.
    """
    tracker, file = method.tracker.tracker, recording.annotations
    held_out = {(name, seed) for name, seed, _ in HELD_OUT}
    marked = file is not None and read_annotations(file).split == "test"
    if marked or (recording.scenario, recording.seed) in held_out:
        raise ConfigError(
            f"{recording.name} is in the test split: settings searched on it cannot be judged",
            "Search on another recording.",
        )
    if tracker not in SEARCHED:
        raise ConfigError(
            f"tracker {tracker} has no settings to search", f"Known are {', '.join(SEARCHED)}."
        )


@dataclass
class Tuner:
    """Scores settings of a tracker on a recording and on the shipped one, each once."""

    run: EvaluationRun
    shipped: EvaluationRun
    _sums: dict[tuple[bool, bytes], F64] = field(default_factory=dict)

    def tune(self, budget: TuningBudget, on_progress: OnProgress) -> TuningResult:
        """Search settings with cross-validation.

        The time decides on the number of candidates in the first search; the others have as many.
        SourceError if the recording is too short.
        """
        before = self.sums({})
        if len(before) < FOLDS:
            raise SourceError(
                f"{self.run.recording.path} has ground truth for {len(before)} s: expected "
                f"{FOLDS} s or more",
                "Annotate more of it.",
            )
        parts = np.arange(len(before))
        after = np.zeros_like(before)
        for number, fold in enumerate(np.array_split(parts, FOLDS), 1):
            rest, stage = np.setdiff1d(parts, fold), f"search {number} of {FOLDS + 1}"
            tried = self._search(rest, budget, on_progress, stage)
            budget = replace(budget, candidates=len(tried) - 1)
            after[fold] = self.sums(self._best(tried, rest))[fold]
        tried = self._search(parts, budget, on_progress, f"search {FOLDS + 1} of {FOLDS + 1}")
        gain, *others = compare_sums(before, after)
        return TuningResult(
            settings=self._best(tried, parts),
            gain=gain,
            worse=tuple(one for one in others if one.is_worse),
            candidates=budget.candidates,
        )

    def sums(self, settings: Settings, shipped: bool = False) -> F64:
        """Return the sums of each part under some settings."""
        run = self.shipped if shipped else self.run
        key = shipped, msgspec.json.encode(sorted(settings.items()))
        if key not in self._sums:
            method = with_settings(run.method, settings)
            self._sums[key] = part_sums(execute(replace(run, method=method)).matching)
        return self._sums[key]

    def _search(
        self, parts: I64, budget: TuningBudget, on_progress: OnProgress, stage: str
    ) -> list[Settings]:
        """Try settings on some parts, the given ones first."""
        import optuna  # noqa: PLC0415 (an extra)

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        study = optuna.create_study(
            direction="maximize", sampler=optuna.samplers.TPESampler(seed=budget.seed)
        )
        ranges: dict[str, optuna.distributions.BaseDistribution] = {
            one.path: optuna.distributions.IntDistribution(int(one.low), int(one.high), log=True)
            if one.integer
            else optuna.distributions.FloatDistribution(one.low, one.high, log=True)
            for one in SEARCHED[self.run.method.tracker.tracker]
        }
        study.enqueue_trial(dict(_given(self.run.method, ranges)))
        tried: list[Settings] = [{}]
        seconds = budget.minutes * 60 / (FOLDS + 1)
        for share in _shares(seconds, budget.candidates):
            on_progress(stage, share)
            candidate = study.ask(ranges)
            rounded = {
                p: x if isinstance(x, int) else round(x, 4) for p, x in candidate.params.items()
            }
            study.tell(candidate, _idf1(self.sums(rounded), parts))
            tried.append(rounded)
        on_progress(stage, 1.0)
        return tried

    def _best(self, tried: Sequence[Settings], parts: I64) -> Settings:
        """Return the best settings on some parts that are not worse on the shipped recording."""
        limit = _idf1(self.sums({}, shipped=True))
        for one in sorted(tried, key=lambda one: -_idf1(self.sums(one), parts)):
            if _idf1(self.sums(one, shipped=True)) >= limit:
                return one
        raise AssertionError("the given settings are not worse than themselves")


def tune_plan(
    plan: EvaluationPlan,
    shipped: EvaluationRecording,
    budget: TuningBudget,
    on_progress: OnProgress,
) -> TuningResult:
    """Search settings of the only method of a plan on its only recording.

    ConfigError if the recording is in the test split; SourceError if a recording cannot be read,
    has no truth, or is too short; ModelError if a model is absent.
    """
    (recording,), (method,) = plan.recordings, plan.methods
    check_tuning(recording, method)
    check_models(plan)
    render_all(plan, on_progress)
    own = replace(method, camera=CameraConfig())  # the shipped recording has its own mount
    other = replace(plan, methods=(own,), recordings=(shipped,))
    with Pool(1, on_progress) as pool:
        (run,), (shipped_run,) = (runs_of(one, pool) for one in (plan, other))
    return Tuner(run, shipped_run).tune(budget, on_progress)


def with_settings(method: Method, settings: Mapping[str, float]) -> Method:
    """Return a method with changed settings of its tracker."""
    fields = msgspec.to_builtins(method.tracker)
    for path, value in settings.items():
        *tables, name = path.split(".")
        table = fields
        for one in tables:
            table = table[one]
        table[name] = value
    return replace(method, tracker=msgspec.convert(fields, TrackerConfig))


def preset_text(preset: str, result: TuningResult, comments: Sequence[str]) -> str:
    """Return a preset with the settings found and all others of a preset."""
    lines = [f"# {comment}" for comment in comments]
    found = {f"tracker.{path}": f"{value:.6g}" for path, value in result.settings.items()}
    if preset.endswith(".toml"):  # may lie in another folder
        found = dict(one.split("=", 1) for one in preset_settings(preset)) | found
    else:
        lines.append(f"extends = {json.dumps(preset)}")
    return "\n".join([*lines, *(f"{path} = {value}" for path, value in found.items()), ""])


def _shares(seconds: float, candidates: int) -> Iterator[float]:
    """Yield the elapsed share of a search before each candidate."""
    begin_s, count = time.monotonic(), 0
    while count < CANDIDATES_MIN or (
        count < candidates if candidates else time.monotonic() - begin_s < seconds
    ):
        yield (
            count / candidates if candidates else min((time.monotonic() - begin_s) / seconds, 0.99)
        )
        count += 1


def _given(method: Method, ranges: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield the values of searched settings in a method, inside their ranges."""
    for path, limits in ranges.items():
        value: Any = method.tracker
        for name in path.split("."):
            value = getattr(value, name)
        yield path, min(max(value, limits.low), limits.high)


def _idf1(sums: F64, parts: I64 | slice = ALL) -> float:
    """Return IDF1 of some parts; 0 without people and tracks."""
    return float(np.nan_to_num(pool(sums[parts].sum(axis=0), FIGURES)[IDF1]))
