"""Identity measures worked on paper [Ristani 2016]."""

from common.metrics.identity import IdentityCounts, count_identity
from common.metrics.matching import match
from common.metrics.record import EvaluationSequence
from common.metrics.similarity import GroundDistance
from tests.common.metrics.worlds import sequence, truth


def count(recording: EvaluationSequence) -> IdentityCounts:
    return count_identity(match(recording, GroundDistance(0.5)))


def test_the_longest_track_gives_the_name() -> None:
    # A has track 1 in three frames and track 2 in one. A is 1: IDTP = 3, the fourth frame is a
    # miss (IDFN = 1) and track 2 a false alarm (IDFP = 1): IDF1 = 6 / (6 + 1 + 1) = 0.75.
    counts = count(sequence(*[({"A": 0}, {1: 0})] * 3, ({"A": 0}, {2: 0})))
    assert counts == IdentityCounts(idtp=3, idfn=1, idfp=1)
    assert (counts.idf1, counts.idp, counts.idr) == (0.75, 0.75, 0.75)


def test_a_swap_costs_by_its_length() -> None:
    # Swapped after two of five frames: A is 2 and B is 1, right in three frames each:
    # IDTP = 6 of 10 truths and 10 tracked: IDF1 = 12 / 20.
    counts = count(
        sequence(*[({"A": 0, "B": 9}, {1: 0, 2: 9})] * 2, *[({"A": 0, "B": 9}, {2: 0, 1: 9})] * 3)
    )
    assert counts == IdentityCounts(idtp=6, idfn=4, idfp=4)
    assert counts.idf1 == 0.6


def test_precision_and_recall_differ() -> None:
    # A in four frames, track 1 there in two, track 9 elsewhere in one:
    # IDR = 2/4, IDP = 2/3, IDF1 = 4 / (4 + 1 + 2).
    counts = count(sequence(*[({"A": 0}, {1: 0})] * 2, ({"A": 0}, {9: 5}), ({"A": 0}, {})))
    assert (counts.idr, counts.idp, counts.idf1) == (2 / 4, 2 / 3, 4 / 7)


def test_all_pairs_count_not_the_best_pair() -> None:
    # Frames together: A-1 3, A-2 2, B-1 2, B-2 0. A-1 alone gives 3, A-2 and B-1 give 4.
    counts = count(
        sequence(*[({"A": 0}, {1: 0})] * 3, *[({"A": 0}, {2: 0})] * 2, *[({"B": 9}, {1: 9})] * 2)
    )
    assert counts.idtp == 4


def test_who_need_not_be_found_has_no_part() -> None:
    counts = count(sequence(({"A": 0}, {1: 0}), (truth({"A": 0}, out="A"), {2: 0})))
    assert counts == IdentityCounts(idtp=1)
