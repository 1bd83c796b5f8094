"""The planner of the documentation, in a process of its own, through the router."""

import subprocess
import sys

import numpy as np
import pytest

from people4d.messages import Tracks
from tests import ROOT, builders
from tests.network import Network

pytestmark = [pytest.mark.processes, pytest.mark.network]

EXAMPLE = ROOT / "docs" / "examples" / "planner.py"


def people(sequence: int) -> Tracks:
    """One person 3 m ahead, approaching at 2 m/s: 1 m away in a second."""
    track = builders.track(
        id=7,
        position_m=np.array([3.0, 0.0, 1.0]),
        velocity_mps=np.array([-2.0, 0.0, 0.0]),
        yaw_rad=np.pi,
    )
    return builders.tracks(track, stamp_ns=sequence, sequence=sequence)


def test_planner_example_slows_down_for_an_approaching_person(network: Network) -> None:
    bus = network.open("robot", "peer")
    command = [sys.executable, str(EXAMPLE), network.endpoint, "3"]
    planner = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    sequence = 0
    try:
        while planner.poll() is None and sequence < 600:
            bus.publish(people(sequence))
            sequence += 1
            try:
                planner.wait(0.05)
            except subprocess.TimeoutExpired:
                continue
        assert planner.wait(10) == 0
        output, _ = planner.communicate()
    finally:
        planner.kill()
    assert output.splitlines() == ["#7 will be 1.00 m away: slow down"] * 3
