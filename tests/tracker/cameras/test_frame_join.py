"""Frames and embeddings of invented names."""

import msgspec
import numpy as np
import pytest

from people4d.messages import Embeddings
from people4d.messages.base import MAX_CAMERAS
from services.tracker.cameras.frame_join import EARLY_MAX_BYTES, FrameJoin
from services.tracker.config import TrackerConfig
from tests import builders
from tests.contract.examples import BY_NAME


def test_embeddings_of_invented_frames_and_cameras_are_bounded() -> None:
    join = FrameJoin(TrackerConfig(), uses_embeddings=True)
    example = BY_NAME["Embeddings"]
    assert isinstance(example, Embeddings)
    for number in range(60):
        vectors = np.zeros((1, 250_000), np.float32)  # 1 MB each
        join.add_embeddings(
            msgspec.structs.replace(example, stamp_ns=number, detections=(0,), vectors=vectors)
        )
    assert sum(e.vectors.nbytes for e in join._early.values()) <= EARLY_MAX_BYTES
    assert join.counters["late_embeddings"] >= 40
    for number in range(500):
        join.add_detections(builders.detections(camera=f"c{number}"), 0, number)
        join.pop(number, flush=True)
    assert len(join._streams) <= MAX_CAMERAS
    assert len(join._newest) <= MAX_CAMERAS


@pytest.mark.parametrize(("silent_ms", "waits_ms"), [(900, 200), (1100, 0)])
def test_frame_waits_for_an_earlier_one_of_a_camera_that_was_active_within_a_second(
    silent_ms: int, waits_ms: int
) -> None:
    join = FrameJoin(TrackerConfig(reorder_wait_s=0.2), uses_embeddings=False)
    now_ns = 10**10
    join.add_detections(builders.detections(camera="slow"), 0, now_ns - silent_ms * 10**6)
    assert join.pop(now_ns, flush=True)
    join.add_detections(builders.detections(camera="fast"), 10**6, now_ns)
    assert join.wake_ns() == now_ns + waits_ms * 10**6
