"""Flags of every service."""

import os
import re
import socket

import pytest

from common.runtime import process
from people4d.messages.base import NAME
from services.router.build import build
from services.router.config import RouterConfig


def test_a_process_without_a_name_has_one_of_its_own_on_every_host() -> None:
    # Containers number their processes alike: two detectors named detector-7 would be one.
    name = process._instance("detector")
    assert NAME.fullmatch(name)
    assert re.sub(r"[^A-Za-z0-9.-]", "-", socket.gethostname())[:32] in name
    assert name.endswith(f"-{os.getpid()}")


@pytest.mark.parametrize("capacity", ["0", "101", "2.5", "fast"])
def test_a_capacity_out_of_range_is_refused(
    capacity: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        process.main("router", RouterConfig, build, arguments=["--capacity", capacity])
    assert f"expected 1 to 100, got '{capacity}'" in capsys.readouterr().err
