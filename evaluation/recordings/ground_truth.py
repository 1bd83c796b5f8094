"""What is true at the stamps of frames, and who of the people has to be found there."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from common.geometry.transforms import invert
from common.metrics import GroundTruth, TruthBuffer, ground_truth_of, in_view
from evaluation.recordings.recordings import EvaluationRecording
from evaluation.recordings.visibility import SimulatedView, load_views, save_views, simulated_views
from lab.scenario import Scenario
from lab.world import EPOCH_NS
from people4d.errors import SourceError
from people4d.messages import F64, CameraInfo, Truth, TruthPerson
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.sources.registry import open_truth

VISIBLE_MIN = 0.35  # visible share from which a person has to be found
LOST_NS = 2_000_000_000  # so long a person whom motion capture has lost is still taken into account
ALL = 2**40  # messages that are remembered: all


@dataclass(frozen=True)
class TruthFrame:
    """The people at one stamp.

    Args:
        people: All whose position is known, well or about.
        sure: Whose position is known well; others need not be found.
        shares: Part of each body that can be seen, 0 to 1; nobody in it: not known.
        map_from_camera: 4x4, where truth knows it.
    """

    people: tuple[TruthPerson, ...]
    sure: frozenset[str]
    shares: Mapping[str, float] = field(default_factory=dict)
    map_from_camera: F64 | None = None

    def true_people(self, info: CameraInfo, map_from_camera: F64 | None) -> GroundTruth:
        """Return who was there and who had to be found.

        Args:
            info: Calibration.
            map_from_camera: 4x4; None: the view is not known, everybody is in it.
        """
        away = np.array([person.id not in self.sure for person in self.people], np.bool_)
        if map_from_camera is not None:
            positions_m = np.array([person.position_m for person in self.people])
            away |= ~in_view(positions_m, invert(map_from_camera), info)
        shares = [self.shares.get(person.id, 1.0) for person in self.people]
        return ground_truth_of(self.people, away, np.array(shares) < VISIBLE_MIN)


@dataclass(frozen=True)
class SampledTruth:
    """The truth of a take at the stamps of its frames.

    Args:
        frame_id: Frame that positions are in.
        ids: Everyone who was there.
        moments: One for each stamp; None where nothing is known.
    """

    frame_id: str
    ids: tuple[str, ...]
    moments: tuple[TruthFrame | None, ...]

    @property
    def visibility(self) -> bool:
        """Whether it is known how much of each person could be seen."""
        return any(moment is not None and moment.shares for moment in self.moments)


def read_truth(take: EvaluationRecording, stamps_ns: Sequence[int]) -> SampledTruth:
    """Return what was true at the stamps of frames.

    How much of each person could be seen is known in the virtual lab: to the pixel where the truth
    of each frame lies beside the recording, else as far as people hide each other.

    Raises:
        SourceError: The take has no truth, or it cannot be read.
    """
    for path, epoch_ns in ((take.truth_file, EPOCH_NS), (take.path / "gt.npz", 0)):
        if path.is_file():
            happening = sample_truth(_numbered(path, epoch_ns), stamps_ns, str(path))
            return _with_frames(happening, path, [stamp - epoch_ns for stamp in stamps_ns])
    happening = sample_truth(_told(take.path), stamps_ns, str(take.path))
    if take.filmed is None:
        return happening
    views = _views(take, take.filmed, happening, stamps_ns)
    if views is None:
        return happening
    poses = [view.map_from_camera for view in views]
    return _replaced(happening, [view.shares for view in views], poses)


def sample_truth(told: Iterable[Truth], stamps_ns: Sequence[int], where: str) -> SampledTruth:
    """Return the people of messages at other stamps.

    Args:
        told: By rising stamp; one that is older than the last begins a second round, which ends it.
        stamps_ns: Times that are wanted.
        where: What the messages are from, for the error.

    Raises:
        SourceError: There is no message, or they are in several frames.
    """
    near, far = TruthBuffer(keep=ALL), TruthBuffer(max_gap_ns=LOST_NS, keep=ALL)
    ids: dict[str, None] = {}
    for message in told:
        if near.newest_ns is not None and message.stamp_ns <= near.newest_ns:
            break
        ids |= dict.fromkeys(person.id for person in message.people)
        near.add(message)
        far.add(message)
    frames = sorted({message.frame_id for message in near.messages})
    if len(frames) != 1:
        got = f"truth in the frames {', '.join(frames)}" if frames else "no truth"
        raise SourceError(f"{where} has {got}", "One is needed to evaluate: record topic truth.")
    moments = [_moment(near, far, stamp_ns, len(ids)) for stamp_ns in stamps_ns]
    return SampledTruth(frames[0], tuple(ids), tuple(moments))


def _moment(near: TruthBuffer, far: TruthBuffer, stamp_ns: int, count: int) -> TruthFrame | None:
    known = near.at(stamp_ns)
    if known is None:
        return None
    sure = frozenset(person.id for person in known.people)
    about = far.at(stamp_ns) if len(sure) < count else None
    lost = tuple(p for p in about.people if p.id not in sure) if about else ()
    return TruthFrame(known.people + lost, sure)


def _told(path: Path) -> Iterable[Truth]:
    return open_truth(GtBridgeConfig(truth=str(path)))


def _numbered(path: Path, epoch_ns: int) -> Iterator[Truth]:
    """Yield the truth of a rendering under the identities of its motion capture, from 1 on."""
    for message in _told(path):
        people = tuple(replace(p, id=str(k)) for k, p in enumerate(message.people, 1))
        yield replace(message, stamp_ns=message.stamp_ns + epoch_ns, people=people)


def _views(
    take: EvaluationRecording, scenario: Scenario, happening: SampledTruth, stamps_ns: Sequence[int]
) -> list[SimulatedView] | None:
    """Return what the camera saw; it is kept beside what was filmed for an evaluation."""
    kept = take.path.with_suffix(".views.npz") if take.order else None
    views = load_views(kept, stamps_ns) if kept else None
    if views is None:
        views = simulated_views(scenario, take.seed, _places(happening), stamps_ns)
        if views and kept:
            save_views(kept, stamps_ns, views)
    return views


def _places(happening: SampledTruth) -> list[dict[str, F64]]:
    return [
        {person.id: person.position_m for person in moment.people} if moment else {}
        for moment in happening.moments
    ]


def _with_frames(happening: SampledTruth, path: Path, times_ns: Sequence[int]) -> SampledTruth:
    """Add visible shares and poses of the camera from a rendering's truth of each frame."""
    with np.load(path, allow_pickle=False) as file:
        if not {"t", "vis", "T_world_cam"} <= set(file):
            return happening
        kept_ns = np.round(file["t"] * 1e9)
        rows = [int(np.argmin(np.abs(kept_ns - time_ns))) for time_ns in times_ns]
        shares = [
            dict(zip(happening.ids, visible, strict=True))
            for visible in file["vis"][rows].astype(float).tolist()
        ]
        return _replaced(happening, shares, list(file["T_world_cam"][rows]))


def _replaced(
    happening: SampledTruth, shares: Sequence[Mapping[str, float]], poses: Sequence[F64]
) -> SampledTruth:
    moments = tuple(
        TruthFrame(moment.people, moment.sure, share, pose) if moment else None
        for moment, share, pose in zip(happening.moments, shares, poses, strict=True)
    )
    return SampledTruth(happening.frame_id, happening.ids, moments)
