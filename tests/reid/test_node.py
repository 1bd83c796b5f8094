from collections.abc import Sequence

import numpy as np

from common.transport.memory_bus import MemoryBus
from people4d.messages import F32, Crop, Crops, Embeddings, Span
from services.reid.build import build
from services.reid.config import ReidConfig
from services.reid.node import ReidNode


def message(*crops: Crop) -> Crops:
    trace = (Span(stage="detector.crops", process="detector-1@host", start_ns=1, end_ns=2),)
    return Crops(stamp_ns=77, sequence=5, trace=trace, camera="front", crops=crops)


def crop(detection: int, height: int = 40, width: int = 20) -> Crop:
    rng = np.random.default_rng(detection)
    rgb = rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
    return Crop(detection=detection, rgb=rgb)


def embed(node: ReidNode, *crops: Crop) -> Embeddings:
    answer = MemoryBus([node]).publish(message(*crops))[-1]
    assert isinstance(answer, Embeddings)
    return answer


def test_every_crop_gets_a_vector_under_its_detection() -> None:
    node = build(ReidConfig(embedder="histogram"))
    assert isinstance(node, ReidNode)
    answer = embed(node, crop(4), crop(0), crop(2))
    assert (answer.stamp_ns, answer.sequence, answer.camera) == (77, 5, "front")
    assert [span.stage for span in answer.trace] == ["detector.crops"]
    assert (answer.model, answer.detections) == ("histogram", (4, 0, 2))
    for index, row in zip((4, 0, 2), answer.vectors, strict=True):
        np.testing.assert_array_equal(embed(node, crop(index)).vectors[0], row)
    assert node.status().state == "ready"


def test_an_empty_frame_is_answered() -> None:
    node = build(ReidConfig(embedder="histogram"))
    assert isinstance(node, ReidNode)
    answer = embed(node)
    assert answer.detections == ()
    assert answer.vectors.shape == (0, 168)  # 3 parts x (12 x 4 colours + 8 greys)


def test_tiny_crops_are_counted_and_left_out() -> None:
    node = build(ReidConfig(embedder="histogram"))
    assert isinstance(node, ReidNode)
    answer = embed(node, crop(0, width=7), crop(1), crop(2, height=1, width=1))
    assert answer.detections == (1,)
    assert node.status().counters == {"frames": 1, "people": 1, "too_small": 2}


class Fragile:
    """An embedder that fails on the crop of detection 9."""

    name = "fragile"
    dimension = 2

    def embed(self, crops: Sequence[Crop]) -> F32:
        if any(crop.detection == 9 for crop in crops):
            raise RuntimeError("network burst")
        return np.tile(np.array([1, 0], np.float32), (len(crops), 1))


def test_a_failing_embedder_gives_an_empty_frame_and_recovers() -> None:
    node = ReidNode(Fragile())
    assert embed(node, crop(1), crop(9)).vectors.shape == (0, 2)
    assert node.status().state == "degraded"
    assert "network burst" in node.status().reason
    assert node.status().counters["embedder_errors"] == 1
    assert embed(node, crop(1)).detections == (1,)
    assert node.status().state == "ready"
