"""Privacy: another host receives people and not one byte of an image."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import pytest

from common.transport.access import access_control, privacy_control
from common.transport.ports import free_port
from common.transport.zenoh_bus import read_config
from people4d.errors import ConfigError
from people4d.topics import BY_NAME
from scripts.namespaces import hosts, missing
from tests import ROOT

WAIT_S = 60.0
MODULE = [sys.executable, "-m", "tests.security.privacy_host"]
PEOPLE = "people4d/v1/robot/people"
IMAGES = {f"people4d/v1/robot/raw/front/{name}" for name in ("rgbd", "compressed", "crops")}

pytestmark = [pytest.mark.network, pytest.mark.processes]


@contextmanager
def camera(endpoint: str, environment: Mapping[str, str]) -> Iterator[None]:
    command = [*MODULE, "camera", endpoint]
    process = subprocess.Popen(
        command, env=os.environ | environment, stdout=subprocess.PIPE, text=True, cwd=ROOT
    )
    try:
        assert process.stdout
        assert process.stdout.readline() == "ready\n"
        yield
    finally:
        process.send_signal(signal.SIGKILL)
        process.communicate()


def heard(endpoint: str) -> dict[str, int]:
    command = [*MODULE, "listen", endpoint, "20"]
    done = subprocess.run(
        command, capture_output=True, text=True, check=True, timeout=WAIT_S, cwd=ROOT
    )
    found: dict[str, int] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize(
    ("environment", "images"),
    [
        ({}, IMAGES),
        ({"PEOPLE4D_PRIVACY": "on"}, IMAGES),  # this host may see them
        ({"PEOPLE4D_PRIVACY": "on", "PEOPLE4D_LOCAL_INTERFACES": "eth9"}, set()),
    ],
)
def test_images_pass_on_local_interfaces_only(
    environment: Mapping[str, str], images: set[str]
) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with camera(endpoint, environment):
        assert heard(endpoint).keys() == {PEOPLE, *images}


@pytest.mark.skipif(bool(missing()), reason=missing())
@pytest.mark.parametrize("privacy", ["off", "on"])
def test_another_host_hears_no_image(privacy: str) -> None:
    with hosts() as network:
        options = {"cwd": ROOT, "env": os.environ | {"PEOPLE4D_PRIVACY": privacy}}
        served: Sequence[str] = [*MODULE, "camera", "tcp/0.0.0.0:7447"]
        with network.start("nuc", served, stdout=subprocess.PIPE, **options) as process:
            try:
                assert process.stdout
                assert process.stdout.readline() == "ready\n"
                command = [*MODULE, "listen", "tcp/192.168.1.7:7447", "20"]
                found = json.loads(network.run("tracker", command, cwd=ROOT))
            finally:
                process.kill()
    assert found[PEOPLE] > 0
    images = {key: size for key, size in found.items() if "/raw/" in key}
    assert images == {} if privacy == "on" else images.keys() == IMAGES


@pytest.mark.parametrize("proof", ["cert_common_names", "usernames"])
def test_rules_of_roles_hold_compressed_frames_on_the_host(proof: str) -> None:
    for privacy in (False, True):
        rules = access_control(proof, ["lo"], privacy)["rules"]  # type: ignore[arg-type]
        key = "people4d/v1/*/" + BY_NAME["compressed"].key.replace("{camera}", "*")
        names = {rule["id"].partition(":")[0] for rule in rules if key in rule["key_exprs"]}
        assert names
        assert all(name.endswith(" local") for name in names) is privacy


def test_peers_and_clients_have_the_rules_as_well() -> None:
    for mode in ("router", "peer", "client"):
        config = read_config(None, mode, {"PEOPLE4D_PRIVACY": "on"})
        assert json.loads(config.get_json("access_control"))["enabled"], mode
        config = read_config(None, mode, {})
        assert not json.loads(config.get_json("access_control"))["enabled"], mode
    with pytest.raises(ConfigError, match="expected on or off, got 'yes'"):
        read_config(None, "router", {"PEOPLE4D_PRIVACY": "yes"})


def test_only_topics_without_pixels_pass_everywhere() -> None:
    rules = {rule["id"]: rule for rule in privacy_control()["rules"]}
    assert not [key for key in rules["no pixels"]["key_exprs"] if "/raw/" in key]
