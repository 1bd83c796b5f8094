"""Access rules, tried by every role on every topic."""

import itertools
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from common.transport.access import access_control, may_publish, may_read, roles
from people4d.codec import encode
from people4d.topics import BY_MESSAGE, BY_NAME, TOPICS
from tests.contract.examples import BY_NAME as EXAMPLES
from tests.security.guarded import PREFIX, WAIT_S, Guarded, Listener, guarded, settle
from tests.services import SERVICES, node_of

pytestmark = pytest.mark.network

# Written from the purpose of each service, not from the table.
PUBLISHERS = {
    "frames": "camera",
    "compressed": "camera",
    "camera_info": "camera",
    "static_transforms": "camera",
    "odometry": "camera",
    "detections": "detector",
    "crops": "detector",
    "embeddings": "reid",
    "people": "tracker",
    "boxes": "tracker",
    "area_people": "tracker",
    "gait": "gait",
    "predictions": "predictor",
    "skeletons": "skeleton",
    "target": "target",
    "target_commands": "planner",
    "truth": "gt_bridge",
    "score": "gt_bridge",
    "health": "tracker",  # the example is the tracker's health; no other process may publish it
}
MORE_PUBLISHERS = {
    "odometry": {"visual_odometry"},
    "people": {"site"},
    "target_commands": {"dashboard", "operator", "ros2_bridge"},
}
PLANNER_READS = {
    "camera_info",
    "static_transforms",
    "people",
    "boxes",
    "gait",
    "predictions",
    "skeletons",
    "target",
    "events",
    "zones",
    "health",
}
IMAGE_READERS = {
    "frames": {"dashboard", "detector", "gait", "visual_odometry", "report", "operator"},
    "compressed": {"dashboard", "detector", "report", "operator"},
    "crops": {"reid", "operator"},
}


@pytest.fixture(scope="module", params=["certificates", "passwords"])
def network(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Guarded]:
    passwords = request.param == "passwords"
    with guarded(tmp_path_factory.mktemp("keys"), passwords) as network:
        yield network


def key_of(name: str) -> str:
    topic = BY_NAME[name]
    return topic.key_of(EXAMPLES[topic.message.__name__], "robot")


def test_topic_passes_only_from_its_publisher_to_its_readers(network: Guarded) -> None:
    sessions = {role: network.session(role) for role in roles() if role != "router"}
    listeners = {
        (role, name): Listener(session, key_of(name))
        for (role, session), name in itertools.product(sessions.items(), PUBLISHERS)
    }
    for session in sessions.values():
        settle(session)
    for role, session in sessions.items():
        for name in PUBLISHERS:
            session.put(key_of(name), f"{role} sent".encode())
        settle(session)
    for name, publisher in PUBLISHERS.items():
        sessions[publisher].put(key_of(name), b"the end")
    for _ in ("sent", "received"):
        for session in sessions.values():
            settle(session)
    for (role, name), listener in listeners.items():
        publisher = PUBLISHERS[name]
        sent = {
            f"{one} sent".encode()
            for one in ({publisher} | MORE_PUBLISHERS.get(name, set())) - {role}
        }
        # A session receives its own messages, allowed by the router or not.
        from_others = set(listener.received) - {f"{role} sent".encode()}
        if role == publisher:
            readable = sent if may_read(role, BY_NAME[name]) else set[bytes]()
            assert from_others <= {*readable, b"the end"}, (role, name)
        elif may_read(role, BY_NAME[name]):
            assert from_others == {*sent, b"the end"}, (role, name)
        else:
            assert from_others == set(), (role, name)


def test_health_of_a_peer_reaches_subscribers_of_all_health(network: Guarded) -> None:
    """A peer must receive the subscription before it publishes."""
    planner = Listener(network.session("planner"), f"{PREFIX}/health/*/*")
    watchdog = network.bus("watchdog", "peer")
    health = msgspec.structs.replace(EXAMPLES["Health"], service="watchdog")
    end_s = time.monotonic() + WAIT_S
    while encode(health) not in planner.received and time.monotonic() < end_s:
        watchdog.publish(health)
        planner.wait_briefly()
    assert encode(health) in planner.received


def test_every_topic_has_a_publisher_and_a_reader() -> None:
    for topic in TOPICS:
        assert any(may_publish(role, topic) for role in roles()), topic.name
        assert any(may_read(role, topic) for role in roles()), topic.name
        assert set(topic.readers.split()) <= {*roles(), "*"}, topic.name


def test_planner_reads_tracks_health_and_calibration_and_publishes_the_choice() -> None:
    assert {topic.name for topic in TOPICS if may_read("planner", topic)} == PLANNER_READS
    for role in ("planner", "operator"):
        assert [t.name for t in TOPICS if may_publish(role, t)] == ["target_commands"]


def test_images_have_few_readers() -> None:
    for name, readers in IMAGE_READERS.items():
        assert {role for role in roles() if may_read(role, BY_NAME[name])} == readers


@pytest.mark.parametrize("service", SERVICES)
def test_every_service_may_read_its_inputs(service: str, tmp_path: Path) -> None:
    role = service.partition("-")[0]
    node = node_of(service, tmp_path)
    for kind in node.inputs:
        assert may_read(role, BY_MESSAGE[kind]), f"{role} is no reader of {kind.__name__}"
    node.close()


def test_raw_images_pass_only_on_local_interfaces() -> None:
    rules = access_control("cert_common_names")
    subjects = {subject["id"]: subject for subject in rules["subjects"]}
    for policy in rules["policies"]:
        (name,) = policy["subjects"]
        keys = {key for r in rules["rules"] if r["id"] in policy["rules"] for key in r["key_exprs"]}
        raw = {key for key in keys if key.endswith(("/rgbd", "/crops"))}
        assert not raw or subjects[name]["interfaces"] == ["lo"], name
