"""Compiled functions work where nothing can be kept on disk."""

import os
import subprocess
import sys

PROGRAM = (
    "from services.camera.lab.noise import Field, Persistence; "
    "lasting = Persistence(frozen_share=0, correlation_s=1); "
    "print(Field((4, 4), 2, (1,), lasting).at(0).shape)"
)


def test_without_a_folder_to_keep_them_in() -> None:
    # Only a folder named by NUMBA_CACHE_DIR may be used, and none is named.
    limits = {"NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator", "NUMBA_CACHE_DIR": ""}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, **limits},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.stdout, done.returncode) == ("(4, 4)\n", 0), done.stderr
