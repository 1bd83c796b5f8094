"""people4d health: it waits for a router and a service that are still starting."""

import os
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from common.transport.ports import free_port
from deploy.cli import app
from tests.deploy.launcher.test_alone import TIMEOUT_S, ending, service

pytestmark = [pytest.mark.processes, pytest.mark.network]

STARTED_S = 3.0  # duration of the start of the command [s]
CONNECT_S = 0.2  # timeout of one attempt [s]
HEALTH = f"from deploy.cli import app, options; options.CONNECT_S = {CONNECT_S}; app()"


def test_health_waits_for_a_router_that_starts_later() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    variables = {**os.environ, "PEOPLE4D_CONNECT": endpoint}
    command = [sys.executable, "-c", HEALTH, "health", "router", "--timeout", str(TIMEOUT_S)]
    with (
        subprocess.Popen(command, env=variables, stdout=subprocess.PIPE) as process,
        ending(process),
    ):
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(2 * CONNECT_S + STARTED_S)
        with service("router", {**variables, "PEOPLE4D_LISTEN": endpoint}):
            output, _ = process.communicate(timeout=TIMEOUT_S)
    assert (process.returncode, output.split()[1:]) == (0, [b"is", b"ready."])


def test_health_without_a_router_ends_after_its_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deploy.cli.options.CONNECT_S", 0.2)
    command = ["health", "router", "--timeout", "0.1", "--connect", "tcp/127.0.0.1:1"]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 1
    assert "no Zenoh session" in result.stderr
