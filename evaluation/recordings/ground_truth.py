"""Ground truth at the stamps of frames, with flags of people to be tracked."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from common.geometry.transforms import invert
from common.metrics.alignment.truth_buffer import TruthBuffer
from common.metrics.field_of_view import in_view
from common.metrics.from_messages import ground_truth_of
from common.metrics.record import GroundTruth
from evaluation.recordings.recordings import EvaluationRecording
from evaluation.recordings.visibility import SimulatedView, load_views, save_views, simulated_views
from lab.world import EPOCH_NS
from people4d.errors import SourceError
from people4d.messages import F64, CameraInfo, Truth, TruthPerson
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.sources.registry import open_truth

VISIBLE_MIN = 0.35  # minimum visible share of a person to be tracked
LOST_NS = 2_000_000_000  # [ns] maximum interpolated gap of motion capture
UNBOUNDED = 2**40  # number of messages in a buffer


@dataclass(frozen=True)
class TruthFrame:
    """The people at one stamp."""

    people: tuple[TruthPerson, ...]  # people with a position, measured or interpolated
    captured: frozenset[str]  # people with a measured position; others need not be tracked
    shares: Mapping[str, float] = field(default_factory=dict)  # visible share; empty: unknown
    map_from_camera: F64 | None = None  # 4x4, if the truth contains it

    def ground_truth(self, info: CameraInfo, map_from_camera: F64 | None) -> GroundTruth:
        """Return the people, with flags: out of view (absent without a pose), and occluded."""
        away = np.array([person.id not in self.captured for person in self.people], np.bool_)
        if map_from_camera is not None:
            positions_m = np.array([person.position_m for person in self.people])
            away |= ~in_view(positions_m, invert(map_from_camera), info)
        shares = [self.shares.get(person.id, 1.0) for person in self.people]
        return ground_truth_of(self.people, away, np.array(shares) < VISIBLE_MIN)


@dataclass(frozen=True)
class SampledTruth:
    """The truth of a recording at the stamps of its frames."""

    frame_id: str  # frame of the positions
    ids: tuple[str, ...]  # identities of the people in the recording
    frames: tuple[TruthFrame | None, ...]  # one for each stamp; None if unknown

    @property
    def has_visibility(self) -> bool:
        """True if the visible share of people is known."""
        return any(frame is not None and frame.shares for frame in self.frames)

    def with_views(
        self, shares: Iterable[Mapping[str, float]], poses: Iterable[F64]
    ) -> "SampledTruth":
        """Return the truth with visible shares and camera poses, one for each frame."""
        views = zip(self.frames, shares, poses, strict=True)
        frames = [f and TruthFrame(f.people, f.captured, share, pose) for f, share, pose in views]
        return SampledTruth(self.frame_id, self.ids, tuple(frames))


def read_truth(recording: EvaluationRecording, stamps_ns: Sequence[int]) -> SampledTruth:
    """Return the truth at the stamps of frames.

    In the virtual lab the visible share of people is known: from pixels if there is a file with the
    truth of each frame, else from the outlines of the bodies. SourceError if the recording has no
    truth, or it cannot be read.
    """
    for path, epoch_ns in ((recording.truth_file, EPOCH_NS), (recording.path / "gt.npz", 0)):
        if path.is_file():
            sampled = sample_truth(_numbered(path, epoch_ns), stamps_ns, str(path))
            return _with_rendered_views(sampled, path, [stamp - epoch_ns for stamp in stamps_ns])
    sampled = sample_truth(_messages(recording.path), stamps_ns, str(recording.path))
    views = _simulated_views(recording, sampled, stamps_ns)
    if views is None:
        return sampled
    return sampled.with_views([v.shares for v in views], [v.map_from_camera for v in views])


def sample_truth(messages: Iterable[Truth], stamps_ns: Sequence[int], source: str) -> SampledTruth:
    """Return the people of messages of a source at other stamps.

    Messages are by rising stamp; an older one begins a repetition, which is ignored. SourceError if
    there is no message, or they are in several frames.
    """
    near = TruthBuffer(capacity=UNBOUNDED)
    far = TruthBuffer(max_gap_ns=LOST_NS, capacity=UNBOUNDED)
    ids: dict[str, None] = {}
    for message in messages:
        if near.newest_ns is not None and message.stamp_ns <= near.newest_ns:
            break
        ids |= dict.fromkeys(person.id for person in message.people)
        near.add_truth(message)
        far.add_truth(message)
    frame_ids = sorted({message.frame_id for message in near.messages})
    if len(frame_ids) != 1:
        got = f"truth in the frames {', '.join(frame_ids)}" if frame_ids else "no truth"
        raise SourceError(f"{source} has {got}", "One is needed to evaluate: record topic truth.")
    frames = tuple(_frame(near, far, stamp_ns, len(ids)) for stamp_ns in stamps_ns)
    return SampledTruth(frame_ids[0], tuple(ids), frames)


def _frame(near: TruthBuffer, far: TruthBuffer, stamp_ns: int, count: int) -> TruthFrame | None:
    known = near.at(stamp_ns)
    if known is None:
        return None
    captured = frozenset(person.id for person in known.people)
    bridged = far.at(stamp_ns) if len(captured) < count else None
    lost = tuple(p for p in bridged.people if p.id not in captured) if bridged else ()
    return TruthFrame(known.people + lost, captured)


def _messages(path: Path) -> Iterable[Truth]:
    return open_truth(GtBridgeConfig(truth=str(path)))


def _numbered(path: Path, epoch_ns: int) -> Iterator[Truth]:
    """Yield the truth of a rendering under the identities of its motion capture, 1, 2, ..."""
    for message in _messages(path):
        people = tuple(replace(p, id=str(k)) for k, p in enumerate(message.people, 1))
        yield replace(message, stamp_ns=message.stamp_ns + epoch_ns, people=people)


def _simulated_views(
    recording: EvaluationRecording, sampled: SampledTruth, stamps_ns: Sequence[int]
) -> list[SimulatedView] | None:
    """Return the camera's views in the virtual lab, cached for rendered scenarios."""
    if recording.simulation is None:
        return None
    cache = recording.path.with_suffix(".views.npz") if recording.job else None
    views = load_views(cache, stamps_ns) if cache else None
    if views is None:
        positions_m = [
            {person.id: person.position_m for person in frame.people} if frame else {}
            for frame in sampled.frames
        ]
        views = simulated_views(recording.simulation, recording.seed, positions_m, stamps_ns)
        if views and cache:
            save_views(cache, stamps_ns, views)
    return views


def _with_rendered_views(
    sampled: SampledTruth, path: Path, times_ns: Sequence[int]
) -> SampledTruth:
    """Add visible shares and poses of the camera from a rendering's truth of each frame."""
    with np.load(path, allow_pickle=False) as file:
        if not {"t", "vis", "T_world_cam"} <= set(file):
            return sampled
        stamps_ns = np.round(file["t"] * 1e9)
        rows = [int(np.argmin(np.abs(stamps_ns - time_ns))) for time_ns in times_ns]
        shares = [
            dict(zip(sampled.ids, visible, strict=True))
            for visible in file["vis"][rows].astype(float).tolist()
        ]
        return sampled.with_views(shares, list(file["T_world_cam"][rows]))
