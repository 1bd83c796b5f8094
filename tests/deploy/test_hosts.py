"""Launch of the configurations for several hosts."""

from pathlib import Path

import pytest

from deploy.launcher.plan import COMPOSE_FILE, LaunchRequest, plan, router_of
from people4d.errors import ConfigError

HOSTS = COMPOSE_FILE.parent / "hosts"
ROUTER = "tcp/192.168.1.7:7447"


def request(host: str, environment: dict[str, str]) -> LaunchRequest:
    return LaunchRequest(
        compose=HOSTS / f"{host}.yaml", host="0.0.0.0", port=7000, environment=environment
    )


@pytest.mark.slow
def test_host_of_the_camera_has_the_router(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    wanted = request("nuc", {"PEOPLE4D_KEYS": "keys/nuc", "PEOPLE4D_CONNECT": ROUTER})
    services = {service.name: service for service in plan(wanted)}
    assert router_of(list(services.values()), wanted) == "tcp/127.0.0.1:7000"
    assert services["router"].environment["PEOPLE4D_LISTEN"] == "tcp/0.0.0.0:7000"
    for name in ("camera", "detector", "reid"):
        variables = services[name].environment
        assert variables["PEOPLE4D_CONNECT"] == "tcp/127.0.0.1:7000"
        assert variables["PEOPLE4D_LISTEN"] == "tcp/127.0.0.1:0"  # others on this host only
        # Where supervisord runs, a relative path would be another.
        assert variables["PEOPLE4D_KEYS"] == str(tmp_path / "keys" / "nuc")


def test_host_of_the_tracker_connects_to_the_router_of_another() -> None:
    wanted = request("tracker", {"PEOPLE4D_KEYS": "/keys/tracker", "PEOPLE4D_CONNECT": ROUTER})
    services = plan(wanted)
    assert {service.name for service in services} == {"tracker", "watchdog"}
    assert router_of(services, wanted) == ROUTER
    for service in services:
        assert service.environment["PEOPLE4D_CONNECT"] == ROUTER
        assert service.environment["PEOPLE4D_MODE"] == "client"


def test_host_without_a_router_is_rejected() -> None:
    with pytest.raises(ConfigError, match="variable PEOPLE4D_CONNECT is not set: endpoint of the"):
        plan(request("tracker", {"PEOPLE4D_KEYS": "/keys/tracker"}))
