"""Flags of every service."""

import os

from common.runtime import process
from people4d.messages.base import NAME


def test_process_without_a_name_gets_one_that_is_unique_on_every_host() -> None:
    # Containers number their processes alike: two detectors named detector-7 would be one.
    name = process._instance("detector", "host_1.local")
    assert NAME.fullmatch(name)
    assert name == f"detector-host-1.local-{os.getpid()}"
