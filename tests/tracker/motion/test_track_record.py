"""States that a checkpoint may hold."""

import numpy as np
import pytest

from people4d.messages import F64
from services.tracker.motion.track_record import check_state

X, P = np.zeros(6), np.diag([0.04, 0.04, 0.1, 1.0, 1.0, 0.0])


def with_element(array: F64, index: tuple[int, ...], value: float) -> F64:
    changed = array.copy()
    changed[index] = value
    return changed


def test_states_with_positive_semidefinite_covariances_are_accepted() -> None:
    check_state(X, P)
    check_state(np.array([X, X]), np.array([P, 1e10 * P]))


@pytest.mark.parametrize(
    ("x", "P"),
    [
        (with_element(X, (3,), 2e15), P),
        (X, with_element(P, (0, 0), -1e-6)),
        (X, with_element(P, (0, 1), 0.01)),  # not symmetric
        (X, with_element(with_element(P, (3, 5), 0.5), (5, 3), 0.5)),  # of a variance of 0
        (X, 1e20 * P),
        (np.array([X, X]), np.array([P, -P])),
    ],
)
def test_other_states_are_refused(x: F64, P: F64) -> None:
    with pytest.raises(ValueError, match="expected"):
        check_state(x, P)
