"""The shipped recording through all nodes, in one process and in lock-step."""

from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from common.config import load
from common.geometry.transforms import wrap
from common.metrics.from_messages import ground_truth_of, hypotheses_of
from common.metrics.matching import Matcher
from common.metrics.record import EvaluationFrame
from common.metrics.similarity import GroundDistance
from common.runtime.node import Node
from evaluation.pipeline import pipeline, play
from people4d.codec import encode
from people4d.messages import (
    Detections,
    Embeddings,
    Message,
    RgbdFrame,
    StaticTransform,
    Track,
    Tracks,
    Truth,
    TruthPerson,
)
from services.camera.config import CameraConfig
from services.detector.config import DetectorConfig
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.node import GtBridgeNode
from services.gt_bridge.sources.registry import open_truth
from services.tracker.build import build
from services.tracker.config import TrackerConfig
from tests import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("demo_recording")]

DEMO = ROOT / "deploy" / "demo" / "crossing.mcap"
FRAMES = 135
SETTINGS = DEMO.parents[1] / "config" / "people4d.toml"  # what `people4d up` runs with


def detector_config() -> DetectorConfig:
    return load(DetectorConfig, "detector", SETTINGS, environment={})


def tracker_config() -> TrackerConfig:
    return load(TrackerConfig, "tracker", SETTINGS, environment={})


def run(max_frames: int = 0) -> list[Message]:
    """All messages of a run of camera, detector, re-ID, tracker and truth."""
    camera = CameraConfig(
        source=str(DEMO), playback="lockstep", start_delay_s=0.0, max_frames=max_frames
    )
    truth = GtBridgeNode(open_truth(GtBridgeConfig(truth=str(DEMO))))
    nodes: list[Node] = [*pipeline(detector_config(), tracker=tracker_config()), truth]
    return [message for step in play(camera, nodes) for message in step.messages]


@pytest.fixture(scope="module")
def messages() -> list[Message]:
    return run()


def match_people(people: Sequence[TruthPerson], tracks: Sequence[Track]) -> list[tuple[int, int]]:
    """Return the pairs (person, track) within 1 m with the least sum of distances."""
    frame = EvaluationFrame(
        stamp_ns=0, truth=ground_truth_of(people), hypotheses=hypotheses_of(tracks)
    )
    matches = Matcher(GroundDistance()).match(frame)
    return list(zip(matches.rows.tolist(), matches.columns.tolist(), strict=True))


Pair = tuple[int, TruthPerson, Track]  # frame, person and matched track


@pytest.fixture(scope="module")
def pairs(messages: list[Message]) -> list[Pair]:
    """Pairs of people and tracks within 1 m, with the minimum sum of distances."""
    truth = [m for m in messages if isinstance(m, Truth)]
    found: list[Pair] = []
    for frame, message in enumerate(m for m in messages if isinstance(m, Tracks)):
        # The truth has a sample every 10 ms, in which people hardly move.
        people = min(truth, key=lambda t: abs(t.stamp_ns - message.stamp_ns)).people
        matched = match_people(people, message.tracks)
        found += [(frame, people[i], message.tracks[k]) for i, k in matched]
    return found


def apart_m(track: Track, person: TruthPerson) -> float:
    return float(np.linalg.norm((track.position_m - person.position_m)[:2]))


def settled(pairs: Sequence[Pair]) -> list[Pair]:
    """Pairs after the first half second: a track begins at rest and needs time for its speed."""
    return [pair for pair in pairs if pair[2].age > 8]


def rms(errors: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def test_every_frame_has_one_answer_in_order(messages: list[Message]) -> None:
    frames = [(m.stamp_ns, m.sequence) for m in messages if isinstance(m, RgbdFrame)]
    assert len(frames) == FRAMES
    assert len(set(frames)) == FRAMES
    for kind in (Detections, Embeddings, Tracks):
        assert [(m.stamp_ns, m.sequence) for m in messages if isinstance(m, kind)] == frames


def test_three_people_have_three_constant_identities(pairs: list[Pair]) -> None:
    identities = {(person.id, track.id) for _, person, track in pairs}
    assert len(identities) == 3
    assert len({name for name, _ in identities}) == len({number for _, number in identities}) == 3
    # All people are in view all the time; a track begins at the third frame and survives occlusion.
    assert len(pairs) >= 3 * (FRAMES - 5)


def test_only_three_tracks_are_confirmed(messages: list[Message]) -> None:
    tracks = [t for m in messages if isinstance(m, Tracks) for t in m.tracks]
    assert len({t.id for t in tracks if t.state == "confirmed"}) == 3


def test_positions_lie_on_the_axis_of_the_body(messages: list[Message], pairs: list[Pair]) -> None:
    """Depth is read on the surface that faces the camera, half a body before the axis."""
    assert np.median([apart_m(track, person) for _, person, track in pairs]) < 0.05
    assert rms([apart_m(track, person) for _, person, track in pairs]) < 0.12
    (transform,) = (m for m in messages if isinstance(m, StaticTransform))
    ray = [p.position_m - transform.matrix[:3, 3] for _, p, _ in pairs]
    short_m = [
        float((p.position_m - t.position_m) @ r / np.linalg.norm(r))
        for (_, p, t), r in zip(pairs, ray, strict=True)
    ]
    assert abs(np.median(short_m)) < 0.03
    heights_m = [float(t.position_m[2] - p.position_m[2]) for _, p, t in pairs]
    assert abs(np.median(heights_m)) < 0.05


def test_velocity_follows_the_person(pairs: list[Pair]) -> None:
    """The error is far below a constant velocity of 0, although people stop and turn all the
    time."""
    errors, speeds = [], []
    for _, person, track in settled(pairs):
        assert person.velocity_mps is not None
        errors.append(float(np.linalg.norm((track.velocity_mps - person.velocity_mps)[:2])))
        speeds.append(float(np.linalg.norm(person.velocity_mps[:2])))
    assert rms(errors) < 0.25
    assert rms(errors) < 0.5 * rms(speeds)


def test_yaw_is_that_of_the_chest(pairs: list[Pair]) -> None:
    errors = [
        abs(wrap(track.yaw_rad - person.yaw_rad))
        for _, person, track in settled(pairs)
        if track.yaw_rad is not None and person.yaw_rad is not None
    ]
    assert len(errors) > 0.9 * len(settled(pairs))  # standing people included
    assert np.median(errors) < np.radians(12)
    assert np.percentile(errors, 90) < np.radians(30)


def test_same_recording_gives_the_same_tracks(messages: list[Message]) -> None:
    """Byte for byte, except the times in the trace; a third of the recording suffices."""
    again = answers(run(max_frames=25))
    assert len(again) == 25
    assert again == answers(messages)[:25]


def test_embeddings_before_their_detections_change_nothing(messages: list[Message]) -> None:
    parts = [m for m in messages if isinstance(m, Detections | Embeddings)]
    # Within each stamp only: the sort is stable.
    parts.sort(key=lambda m: (m.stamp_ns, isinstance(m, Detections)))
    assert isinstance(parts[0], Embeddings)
    assert tracked(messages, parts) == answers(messages)


def test_embeddings_one_frame_late_change_nothing(messages: list[Message]) -> None:
    """The detections of the next frame overtake the embeddings of this one."""
    detections = [m for m in messages if isinstance(m, Detections)]
    embeddings = [m for m in messages if isinstance(m, Embeddings)]
    parts: list[Message] = [detections[0]]
    for ahead, behind in zip(detections[1:], embeddings, strict=False):
        parts += [ahead, behind]
    assert tracked(messages, [*parts, embeddings[-1]]) == answers(messages)


def tracked(messages: Sequence[Message], parts: Sequence[Message]) -> list[bytes]:
    """Return tracks of the tracker alone for messages in a given order."""
    node = build(tracker_config())
    for transform in (m for m in messages if isinstance(m, StaticTransform)):
        node.handle(transform, 0)
    outputs = [output for part in parts for output in node.handle(part, 0)]
    return [without_trace(m) for m in outputs]


def answers(messages: Sequence[Message]) -> list[bytes]:
    return [without_trace(m) for m in messages if isinstance(m, Tracks)]


def without_trace(message: Message) -> bytes:
    return encode(msgspec.structs.replace(message, trace=()))
