"""What several tests need."""

from pathlib import Path

import pytest

from tests import SHARED


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of reference inputs beside the repository; skips where it is absent."""
    if not (SHARED / "data").is_dir():
        pytest.skip("reference data (../shared) is not beside the repository")
    return SHARED
