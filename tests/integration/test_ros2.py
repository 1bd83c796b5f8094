"""people4d up --ros2: the system publishes people to a client that others wrote."""

import subprocess
import sys
from pathlib import Path

import pytest
from zenoh_ros2_sdk import ROS2Subscriber, discovery

from common.ros2.messages.people import PEOPLE
from common.transport.ports import free_port
from people4d.client import Client
from people4d.messages import Health
from tests import DEMO, ROOT
from tests.common.ros2.foreign import Received, Sdk, until

pytestmark = [pytest.mark.processes, pytest.mark.network]

COMMAND = (sys.executable, "-c", "from people4d_command import main; main()")


@pytest.mark.timeout(300)
def test_people_reach_a_client_of_ros(
    tmp_path: Path, state_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PEOPLE4D_STATE", str(state_folder))
    endpoint = f"tcp/127.0.0.1:{free_port()}"

    def people4d(*arguments: str) -> None:
        done = subprocess.run(
            [*COMMAND, *arguments], check=False, capture_output=True, text=True, cwd=ROOT
        )
        assert done.returncode == 0, done.stdout + done.stderr

    port = endpoint.rpartition(":")[2]
    people4d("up", "--source", str(DEMO), "--loop", "--ros2", "zenoh", "--port", port, "-d")
    sdk = None
    try:
        sdk = Sdk(endpoint, tmp_path)
        heard = Received()

        def note(message: object) -> None:
            if message.people:  # type: ignore[attr-defined]
                heard(message)

        subscriber = ROS2Subscriber("/people", PEOPLE, note, sdk.learn(PEOPLE), **sdk.where)
        person = heard.wait().people[0]
        assert int(person.tags[0]) == int(person.name)
        topics = {"/people", "/people4d/markers"}
        until(lambda: topics <= dict(discovery.get_topic_names_and_types(**sdk.where)).keys())
        with Client(endpoint) as client:
            healths = client.messages(Health, timeout_s=30)
            bridge = next(health for health in healths if health.service == "ros2_bridge")
        assert bridge.counters["ros2_sent"] > 0
        assert bridge.counters["send_errors"] == 0
        subscriber.close()
    finally:
        if sdk:
            sdk.close()
        people4d("down")
