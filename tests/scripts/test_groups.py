"""Groups of tests: pytest-xdist gives all tests of one group to one worker."""

import pytest


@pytest.mark.xdist_group("groups")
def test_a_group_stands_in_the_ids_of_its_tests(request: pytest.FixtureRequest) -> None:
    """Workers mark ids; a release of pytest whose ids they cannot mark would undo all groups."""
    if not getattr(request.config.option, "loadgroup", False):
        pytest.skip("tests are not distributed by groups")
    assert request.node.nodeid.endswith("@groups")
