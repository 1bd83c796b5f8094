"""Small sequences written by hand: everybody stands on the x axis."""

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np

from common.metrics import EvaluationFrame, EvaluationSequence, GroundTruth, Hypotheses, Id

Places: TypeAlias = Mapping[Any, float]  # id -> x in metres


def truth(places: Places, out: str = "", hidden: str = "") -> GroundTruth:
    """Put people to x; those named in `out` and `hidden` are out of view and occluded."""
    return GroundTruth(
        ids=tuple(places),
        positions_m=np.array([(x, 0.0, 0.0) for x in places.values()]).reshape(-1, 3),
        out_of_view=np.array([str(i) in out for i in places], np.bool_),
        occluded=np.array([str(i) in hidden for i in places], np.bool_),
    )


def tracked(places: Places, predicted: tuple[Id, ...] = ()) -> Hypotheses:
    """Put tracks to x; some of them only predicted."""
    return Hypotheses(
        ids=tuple(places),
        positions_m=np.array([(x, 0.0, 0.0) for x in places.values()]).reshape(-1, 3),
        predicted=np.array([i in predicted for i in places], np.bool_),
    )


def sequence(*frames: tuple[Places | GroundTruth, Places | Hypotheses]) -> EvaluationSequence:
    """Put frames together at 2 Hz."""
    return EvaluationSequence(
        "hand-made",
        tuple(
            EvaluationFrame(
                stamp_ns=index * 500_000_000,
                truth=people if isinstance(people, GroundTruth) else truth(people),
                hypotheses=told if isinstance(told, Hypotheses) else tracked(told),
            )
            for index, (people, told) in enumerate(frames)
        ),
    )
