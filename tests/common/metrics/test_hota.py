"""HOTA computed by hand [Luiten 2020]."""

import numpy as np
import pytest

from common.metrics.hota import ALPHAS, HotaCounts, count_hota
from common.metrics.matching import match
from common.metrics.record import EvaluationSequence
from common.metrics.similarity import GroundDistance
from tests.common.metrics.worlds import sequence, truth


def count(recording: EvaluationSequence) -> HotaCounts:
    return count_hota(match(recording, GroundDistance(0.5)))


def test_thresholds() -> None:
    assert pytest.approx([0.05 * n for n in range(1, 20)]) == ALPHAS


def test_a_name_changed_at_half_time() -> None:
    # Four frames, all found exactly: DetA = 1. Each match has TPA = 2, FNA = 2 (A under the other
    # name), FPA = 0: A(c) = 2/4. HOTA = sqrt(1 x 0.5), for every alpha.
    counts = count(sequence(*[({"A": 0}, {1: 0})] * 2, *[({"A": 0}, {2: 0})] * 2))
    assert counts.det_a == pytest.approx(np.ones(19))
    assert counts.ass_a == pytest.approx(np.full(19, 0.5))
    assert counts.hota == pytest.approx(np.full(19, 0.5**0.5))


def test_misses_and_false_alarms() -> None:
    # Four truths, three found by track 1; track 9 is with none: TP = 3, FN = 1, FP = 1:
    # DetA = 3/5. TPA = 3, FNA = 1, FPA = 0: AssA = 3/4. HOTA = sqrt(0.45).
    counts = count(sequence(*[({"A": 0}, {1: 0})] * 3, ({"A": 0}, {9: 5})))
    assert counts.det_a == pytest.approx(np.full(19, 0.6))
    assert counts.hota == pytest.approx(np.full(19, 0.45**0.5))


def test_distance_decides_up_to_which_threshold_a_pair_matches() -> None:
    # 0.4 m apart: similarity 1 - 0.4 / 1 = 0.6, a match for alpha 0.05 to 0.60: 12 of 19.
    counts = count(sequence(({"A": 0}, {1: 0.4})))
    assert counts.tp.tolist() == [1.0] * 12 + [0.0] * 7
    assert counts.hota.mean() == pytest.approx(12 / 19)


def test_matches_follow_the_identities_of_all_frames() -> None:
    # Track 1 is A's in three frames. In the fourth the similarities are 0.9 (1) and 0.95 (2): they
    # share A by 0.9/1.85 = 0.486 and 0.95/1.85 = 0.514. Alignment of A and 1: 3.486 frames together
    # of 4 + 4 - 3.486: 0.772; of A and 2: 0.514 of 4 + 1 - 0.514: 0.114. 0.772 x 0.9 wins.
    counts = count(sequence(*[({"A": 0}, {1: 0})] * 3, ({"A": 0}, {1: 0.1, 2: 0.05})))
    assert counts.tp[0] == 4
    assert counts.ass_a[0] == pytest.approx(1.0)


def test_who_need_not_be_found_has_no_part() -> None:
    counts = count(sequence(({"A": 0}, {1: 0}), (truth({"A": 0}, out="A"), {2: 0})))
    assert counts.hota == pytest.approx(np.ones(19))
