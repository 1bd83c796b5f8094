"""Crops to embeddings."""

from collections import Counter
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from common.runtime.node import Node, Sharing, Status
from people4d.messages import Crops, Embeddings, Message
from services.reid.embedders import Embedder

SIDE_MIN_PX = 8  # minimum side of an informative crop [px]


class ReidNode(Node):
    """Embeds the people of each frame; a frame without people gives a message without vectors.

    Args:
        embedder: Maps crops to vectors.
    """

    inputs: tuple[type[Message], ...] = (Crops,)
    sharing: ClassVar[Sharing] = Sharing(Crops, Embeddings)
    required_inputs = inputs

    def __init__(self, embedder: Embedder) -> None:
        self._embedder = embedder
        self._counters: Counter[str] = Counter()
        self._fault = ""

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Return the embeddings of the crops of a frame."""
        if not isinstance(message, Crops):
            return ()
        crops = [crop for crop in message.crops if min(crop.rgb.shape[:2]) >= SIDE_MIN_PX]
        self._counters["frames"] += 1
        self._counters["people"] += len(crops)
        self._counters["too_small"] += len(message.crops) - len(crops)
        try:
            vectors = self._embedder.embed(crops)
            self._fault = ""
        except Exception as error:  # a plug-in embedder may raise any exception
            self._counters["embedder_errors"] += 1
            self._fault = f"the embedder failed: {error!r:.200}"
            crops, vectors = [], np.zeros((0, self._embedder.dimension), np.float32)
        return (
            Embeddings(
                stamp_ns=message.stamp_ns,
                sequence=message.sequence,
                trace=message.trace,
                camera=message.camera,
                model=self._embedder.name,
                detections=tuple(crop.detection for crop in crops),
                vectors=vectors,
            ),
        )

    def status(self) -> Status:
        """Return the counters, and the error of the newest frame as the reason."""
        return Status(
            state="degraded" if self._fault else "ready",
            reason=self._fault,
            counters=dict(self._counters),
        )
