"""Tests that are repeated."""

import pytest

from tests import ROOT
from tests.conftest import SCHEDULED


def test_only_tests_of_the_listed_files_are_repeated(request: pytest.FixtureRequest) -> None:
    assert not request.node.get_closest_marker("flaky")
    for item in request.session.items:
        assert bool(item.get_closest_marker("flaky")) == (item.location[0] in SCHEDULED)
    assert all((ROOT / file).is_file() for file in SCHEDULED)
