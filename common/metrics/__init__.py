"""How good tracking is: one record of what was true and what was told, and the figures on it.

`score(sequence, similarity)` gives everything of method book section 9 for one sequence. Scores
hold counts and sums, so that `combine` pools sequences properly; ratios are taken at the end.
"""

from common.metrics.alignment import (
    ClockOffset,
    Motion,
    estimate_clock,
    estimate_motion,
    fit_2d,
    fit_3d,
    moved,
)
from common.metrics.clear import ClearCounts, IdSwitch, id_switches
from common.metrics.hota import ALPHAS, HotaCounts
from common.metrics.identity import IdentityCounts
from common.metrics.interpolation import TruthTrail, interpolate
from common.metrics.lifetimes import Lifetimes
from common.metrics.matching import History, Matcher, Matching, Step, match
from common.metrics.paths import paths_of
from common.metrics.pose import PoseErrors
from common.metrics.record import Frame, Id, Sequence, TrackedPeople, TruePeople
from common.metrics.returns import Return, find_returns
from common.metrics.scores import Row, Scores, combine, score, score_matching
from common.metrics.similarity import GroundDistance, Similarity, box_overlap
from common.metrics.spread import Spread, summarise
from common.metrics.view import in_view

__all__ = [
    "ALPHAS",
    "ClearCounts",
    "ClockOffset",
    "Frame",
    "GroundDistance",
    "History",
    "HotaCounts",
    "Id",
    "IdSwitch",
    "IdentityCounts",
    "Lifetimes",
    "Matcher",
    "Matching",
    "Motion",
    "PoseErrors",
    "Return",
    "Row",
    "Scores",
    "Sequence",
    "Similarity",
    "Spread",
    "Step",
    "TrackedPeople",
    "TruePeople",
    "TruthTrail",
    "box_overlap",
    "combine",
    "estimate_clock",
    "estimate_motion",
    "find_returns",
    "fit_2d",
    "fit_3d",
    "id_switches",
    "in_view",
    "interpolate",
    "match",
    "moved",
    "paths_of",
    "score",
    "score_matching",
    "summarise",
]
