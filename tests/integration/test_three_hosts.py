"""Commands of docs/launch/hosts.md on three hosts made of network namespaces."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from scripts.namespaces import Hosts, hosts, missing
from tests import ROOT

pytestmark = pytest.mark.processes

BLOCK = re.compile(r"^```sh on=(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
HOSTS = ("tracker", "nuc")  # where something runs
TIMEOUT_S = 100.0


def environment(host: str, home: Path) -> dict[str, str]:
    """Return the variables of a user who has just logged in."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith("PEOPLE4D_")}
    bin_folder = str(Path(sys.executable).parent)
    return {
        **inherited,
        "PATH": f"{bin_folder}:{os.environ['PATH']}",
        "PEOPLE4D_STATE": str(home / host),  # they share this machine's disk
        "OMP_NUM_THREADS": "1",
    }


@pytest.fixture
def world(tmp_path: Path, state_folder: Path) -> Iterator[Hosts]:
    if why := missing():
        pytest.skip(why)
    for name in ("deploy", "docs"):
        (tmp_path / name).symlink_to(ROOT / name)
    with hosts() as world:
        try:
            yield world
        finally:
            for host in HOSTS:
                down = [sys.executable, "-m", "deploy.cli", "down"]
                world.run(host, down, env=environment(host, state_folder), cwd=ROOT)


@pytest.mark.timeout(300)
def test_documented_commands_bring_tracks_to_the_planner(
    world: Hosts, tmp_path: Path, state_folder: Path
) -> None:
    blocks = BLOCK.findall((ROOT / "docs" / "launch" / "hosts.md").read_text(encoding="utf-8"))
    assert [host for host, _ in blocks] == ["nuc", "nuc", "tracker", "planner"]
    for host, text in blocks:
        try:
            printed = world.run(
                host,
                ["bash", "-ec", text],
                env=environment(host, state_folder),
                cwd=tmp_path,
                timeout=TIMEOUT_S,
            )
        except subprocess.CalledProcessError as error:
            pytest.fail(f"{host}: {text}\n{error.stdout}\n{error.stderr}")
    assert "people in map" in printed  # the last is the planner's
