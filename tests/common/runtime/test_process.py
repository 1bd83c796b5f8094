"""Flags of every service, and what happens once it has loaded."""

import gc
import os

from common.runtime import process
from people4d.messages.base import NAME


def test_process_without_a_name_gets_one_that_is_unique_on_every_host() -> None:
    # Containers number their processes alike: two detectors named detector-7 would be one.
    name = process._instance("detector", "host_1.local")
    assert NAME.fullmatch(name)
    assert name == f"detector-host-1.local-{os.getpid()}"


def test_what_was_loaded_is_not_searched_by_the_garbage_collector_again() -> None:
    loaded = [[k] for k in range(1000)]
    try:
        process.release_memory()
        assert not {id(one) for one in gc.get_objects()} & set(map(id, loaded))
    finally:
        gc.unfreeze()
