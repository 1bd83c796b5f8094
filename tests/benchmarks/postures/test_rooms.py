"""Numbers of views of empty rooms, and of rooms with objects."""

import pytest

from benchmarks.lib.postures.rooms import KINDS, view_seeds


@pytest.mark.parametrize(("views", "empty", "objects"), [(60, 60, 6), (10, 10, 1), (5, 5, 1)])
def test_a_tenth_of_the_views_has_objects_and_at_least_one(
    views: int, empty: int, objects: int
) -> None:
    assert view_seeds(KINDS["without furniture"], views) == range(empty)
    assert view_seeds(KINDS["with two mannequins"], views) == range(objects)
