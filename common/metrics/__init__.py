"""How good tracking is: one record of what was true and what was told, and the figures on it.

`score(sequence, similarity)` gives everything of method book section 9 for one sequence. Scores
hold counts and sums, so that `combine` pools sequences properly; ratios are taken at the end.
"""

from common.metrics.clear import ClearCounts, IdSwitch, id_switches
from common.metrics.hota import ALPHAS, HotaCounts
from common.metrics.identity import IdentityCounts
from common.metrics.lifetimes import Lifetimes
from common.metrics.matching import History, Matching, Step, match
from common.metrics.pose import PoseErrors
from common.metrics.record import Frame, Id, Sequence, TrackedPeople, TruePeople
from common.metrics.returns import Return, find_returns
from common.metrics.scores import Row, Scores, combine, score, score_matching
from common.metrics.similarity import GroundDistance, Similarity, box_overlap
from common.metrics.spread import Spread, summarise

__all__ = [
    "ALPHAS",
    "ClearCounts",
    "Frame",
    "GroundDistance",
    "History",
    "HotaCounts",
    "Id",
    "IdSwitch",
    "IdentityCounts",
    "Lifetimes",
    "Matching",
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
    "box_overlap",
    "combine",
    "find_returns",
    "id_switches",
    "match",
    "score",
    "score_matching",
    "summarise",
]
