"""Every registered tracker returns finite numbers for any stream."""

from collections.abc import Sequence

import numpy as np
import pytest

from people4d.messages import Detection, Embeddings, ImageTracks, Message, Tracks
from services.tracker.build import TRACKERS, build
from services.tracker.config import TrackerConfig
from services.tracker.strongsort3d.config import IdentityConfig
from tests import builders
from tests.tracker.scene import published, published_config

MS = 1_000_000
BEST = published(noise="measured", visibility=True, identity=IdentityConfig(enabled=True))
CONFIGS = {name: published_config(tracker=name, publish_tentative=True) for name in TRACKERS} | {
    "all switches on": published_config(strongsort3d=BEST, yaw="keypoints", publish_tentative=True)
}
every_tracker = pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS.keys())


def detection(rng: np.random.Generator, x: float, z: float) -> Detection:
    """Detection with random faults: missing depth, covariance or heading, and absurd values."""
    left, top = 320 + 600 * x / z - 150 / z, 240 - 500 / z
    box = np.array([left, top, left + 300 / z, top + 1000 / z])
    fate = rng.random()
    if fate < 0.03:
        box[2:] = box[:2]  # no area
    elif fate < 0.06:
        box *= 1e2
    position = np.array([x, 0.0, z]) + rng.normal(0, 0.05, 3)
    if fate > 0.9:
        position *= 10.0 ** rng.uniform(-9, 5)
    depth = rng.random() < 0.7
    heading = rng.normal(size=3)
    return Detection(
        box_xyxy_px=box.astype(np.float32),
        score=float(rng.choice([0.0, 0.4, 0.9, 1.0])),
        position_m=position if depth else None,
        position_covariance_m2=10.0 ** rng.uniform(-12, 6) * np.eye(3) if depth else None,
        heading=heading / np.linalg.norm(heading) if rng.random() < 0.6 else None,
        heading_sigma_rad=float(10.0 ** rng.uniform(-6, 2)),
    )


def stream(seed: int, frames: int = 120, people: int = 4) -> list[Message]:
    """Stream with empty frames, gaps, duplicates, late messages and missing embeddings."""
    rng = np.random.default_rng(seed)
    x, z = rng.uniform(-2, 2, people), rng.uniform(1.5, 6, people)
    speed, results, stamp_ns = rng.normal(0, 0.05, people), list[Message](), 1_000 * MS
    for number in range(frames):
        x = x + speed
        stamp_ns += int(rng.choice([33, 100])) * MS
        fate = rng.random()
        if fate < 0.05:
            stamp_ns += 2_000 * MS
        found = builders.detections(
            stamp_ns=stamp_ns - (150 * MS if 0.05 < fate < 0.1 else 0),
            sequence=number,
            frame_id="optical",
            detections=tuple(
                detection(rng, x[k], z[k]) for k in range(people) if rng.random() < 0.9
            )
            * (fate < 0.9),
        )
        results.append(found)
        if 0.1 < fate < 0.2:
            results.append(found)  # a duplicate
        if rng.random() < 0.8 and found.detections:
            vectors = rng.normal(size=(len(found.detections), 8)).astype(np.float32)
            vectors[rng.random(len(vectors)) < 0.1] = 0.0
            results.append(
                Embeddings(
                    stamp_ns=found.stamp_ns,
                    sequence=number,
                    camera="front",
                    model="histogram",
                    detections=tuple(range(len(vectors))),
                    vectors=vectors,
                )
            )
    return results


def play(config: TrackerConfig, messages: Sequence[Message]) -> list[Tracks]:
    node = build(config)
    results, now_ns = list[Message](), 0
    for message in messages:
        now_ns += 40 * MS
        results += [*node.handle(message, now_ns), *node.tick(now_ns)]
    return [message for message in results if isinstance(message, Tracks)]


def check(results: Sequence[Tracks]) -> None:
    for tracks in results:  # Track itself checks that numbers are finite
        ids = [person.id for person in tracks.tracks]
        assert len(set(ids)) == len(ids)
        for person in tracks.tracks:
            assert np.linalg.eigvalsh(person.covariance)[0] > 0
            assert np.abs(person.position_m).max() < 1e4


@every_tracker
@pytest.mark.parametrize("seed", range(3))
def test_stream_with_all_faults_at_once(config: TrackerConfig, seed: int) -> None:
    results = play(config, stream(seed))
    check(results)
    assert len({person.id for tracks in results for person in tracks.tracks}) >= 4


@every_tracker
def test_two_hundred_people(config: TrackerConfig) -> None:
    results = play(config, stream(7, frames=6, people=200))
    check(results)
    # 128 detections of a frame are used, and not all of them become tracks.
    assert max(len(tracks.tracks) for tracks in results) > 80


@every_tracker
def test_tracks_without_any_depth(config: TrackerConfig) -> None:
    blind = [
        builders.detections(
            Detection(box_xyxy_px=np.array([10, 10, 90, 200], np.float32), score=0.9),
            stamp_ns=(1_000 + 33 * number) * MS,
            sequence=number,
            frame_id="optical",
        )
        for number in range(5)
    ]
    node = build(config)
    results = [m for k, frame in enumerate(blind) for m in node.handle(frame, 40 * k * MS)]
    results += node.tick(10_000 * MS)
    assert all(not m.tracks for m in results if isinstance(m, Tracks))
    in_image = [len(m.tracks) for m in results if isinstance(m, ImageTracks)]
    assert in_image == [1] * 5 * (config.tracker == "image_sort")
    assert node.status().counters["without_position"] == 5
