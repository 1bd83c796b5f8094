"""The common record of data sets: source, licence, files, splits, metric and submission."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from typing import Protocol, Self

from common.metrics.scores import Row
from evaluation.methods import Method, read_methods
from people4d.errors import ConfigError, SourceError

SHOWN_MAX = 8  # maximum number of names in an error


class Figures(Protocol):
    """Counts of a metric: adding two pools their sequences."""

    def __add__(self, other: Self) -> Self:
        """Return both sequences together."""

    def row(self) -> Row:
        """Return all figures by name."""


@dataclass(frozen=True)
class SequenceResult:
    """One method on one sequence."""

    figures: Figures | None  # None: the truth of the sequence is not published
    # Contents of the server's files by path; empty: there is no server
    submission: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class DatasetJob:
    """One method to be run on one sequence."""

    folder: Path  # data set
    sequence: str  # one of `Dataset.sequences`
    method: Method
    cache: Path  # folder of converted recordings and detections

    @property
    def path(self) -> Path:
        """Folder of the sequence, if it has its own."""
        return self.folder / self.sequence


@dataclass(frozen=True, kw_only=True)
class Dataset(ABC):
    """A data set: description of its layout, its source, and scores as its own tool computes them.

    Instances are constants of the module of their adapter and listed in `registry.DATASETS`.
    """

    title: str
    layout: str  # address of the public description of its files
    licence: str
    obtain: str  # a sentence: where the files are, and the folder to name
    metric: str  # figures, and the tool that defines them
    server: str  # format of the submission; empty: there is no server
    preset: str  # default method
    columns: tuple[str, ...]  # figures in the table of the terminal; `scores.csv` has all
    tuning: tuple[str, ...]  # patterns of the sequences on which settings may be chosen

    @abstractmethod
    def sequences(self, folder: Path) -> Sequence[str]:
        """Return the names of sequences in a folder with their split, such as train/MOT17-02-DPM.

        SourceError if a file is missing, see `require`.
        """

    @abstractmethod
    def evaluate(self, job: DatasetJob) -> SequenceResult:
        """Run a method on a sequence, and score it as the data set's own tool does.

        SourceError if a file has another layout, or belongs to another sequence.
        """

    def methods(self, presets: Sequence[str], settings: Sequence[str]) -> list[Method]:
        """Return the methods of presets, else the default one; ConfigError if one does not fit."""
        return read_methods(presets or [self.preset], settings)

    def check_tuning(self, sequences: Iterable[str]) -> None:
        """Check that settings may be chosen on sequences.

        ConfigError if one of them is in the test split.
        """
        for name in sequences:
            if not any(fnmatch(name, pattern) for pattern in self.tuning):
                allowed = " or ".join(self.tuning) or "no sequence"
                raise ConfigError(
                    f"{self.title}: tuning expected {allowed}, got {name}",
                    "Settings chosen on a sequence for judging make its figures worthless.",
                )

    def require(self, *paths: Path) -> None:
        """Check that files or folders exist; SourceError names the nearest existing folder."""
        for path in paths:
            if path.exists():
                continue
            there = next((one for one in path.parents if one.is_dir()), Path())
            expected = path.relative_to(there)
            raise SourceError(f"{there}: expected {expected}, got {listed(there)}", self.obtain)

    def mismatch(self, path: Path, expected: object, got: object) -> SourceError:
        """Return the error of a file with another content."""
        return SourceError(f"{path}: expected {expected}, got {got}", self.obtain)


def listed(folder: Path) -> str:
    """Return the names in a folder for an error."""
    names = sorted(one.name for one in folder.iterdir())
    more = [f"and {len(names) - SHOWN_MAX} more"] if len(names) > SHOWN_MAX else []
    return ", ".join(names[:SHOWN_MAX] + more) or "an empty folder"
