"""Compiled functions and their cache on disk."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.processes

PROGRAM = (
    "from lab.depth.noise import NoiseField, Persistence; "
    "persistence = Persistence(frozen_share=0, correlation_s=1); "
    "print(NoiseField((4, 4), 2, (1,), persistence).at(0).shape)"
)


def test_functions_run_without_a_cache_folder() -> None:
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


def test_change_in_a_called_function_of_another_file_is_compiled(tmp_path: Path) -> None:
    # Numba alone checks only the caller's file, and would use the old code.
    head = "from common.compiled import compiled\n"
    called = head + "@compiled\ndef low(x):\n    return x + {}\n"
    caller = head + "from low import low\n@compiled\ndef high(x):\n    return 10 * low(x)\n"
    (tmp_path / "high.py").write_text(caller)
    # Python's own bytecode cache compares whole seconds, and both versions may have the same
    # second.
    no_cache = {"PYTHONDONTWRITEBYTECODE": "1"}
    path = {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    results = []
    for added in (1, 2):
        (tmp_path / "low.py").write_text(called.format(added))
        done = subprocess.run(
            [sys.executable, "-c", "from high import high; print(high(1))"],
            env={**os.environ, **no_cache, **path},
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        results.append((done.stdout, done.stderr))
    assert results == [("20\n", ""), ("30\n", "")]
