"""Small manually written sequences: all people stand on the x axis."""

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np

from common.metrics.record import EvaluationFrame, EvaluationSequence, GroundTruth, Hypotheses, Id

Positions: TypeAlias = Mapping[Any, float]  # id -> x in metres


def truth(positions: Positions, out: str = "", hidden: str = "") -> GroundTruth:
    """Put people at x; `out` names people out of view, `hidden` occluded people."""
    return GroundTruth(
        ids=tuple(positions),
        positions_m=np.array([(x, 0.0, 0.0) for x in positions.values()]).reshape(-1, 3),
        out_of_view=np.array([str(i) in out for i in positions], np.bool_),
        occluded=np.array([str(i) in hidden for i in positions], np.bool_),
    )


def tracked(positions: Positions, predicted: tuple[Id, ...] = ()) -> Hypotheses:
    """Put tracks to x; some of them only predicted."""
    return Hypotheses(
        ids=tuple(positions),
        positions_m=np.array([(x, 0.0, 0.0) for x in positions.values()]).reshape(-1, 3),
        predicted=np.array([i in predicted for i in positions], np.bool_),
    )


def sequence(*frames: tuple[Positions | GroundTruth, Positions | Hypotheses]) -> EvaluationSequence:
    """Put frames together at 2 Hz."""
    return EvaluationSequence(
        "hand-made",
        tuple(
            EvaluationFrame(
                stamp_ns=index * 500_000_000,
                truth=people if isinstance(people, GroundTruth) else truth(people),
                hypotheses=found if isinstance(found, Hypotheses) else tracked(found),
            )
            for index, (people, found) in enumerate(frames)
        ),
    )
