"""Who may say and hear what, tried by everybody on every topic."""

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
from tests.security.guarded import PREFIX, WAIT_S, Ear, Guarded, guarded, settle
from tests.services import SERVICES, node_of

# Written from what each service is for, not from the table.
SPEAKERS = {
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
    "gait": "gait",
    "truth": "gt_bridge",
    "score": "gt_bridge",
    "health": "tracker",  # the example is the tracker's, and nobody speaks for another
}
ALSO = {"odometry": "visual_odometry"}  # who may say it, too
PLANNER_HEARS = {"camera_info", "static_transforms", "people", "boxes", "gait", "health"}
PICTURES_GO_TO = {
    "frames": {"detector", "gait", "visual_odometry", "report", "operator"},
    "compressed": {"detector", "report", "operator"},
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


def test_every_topic_takes_only_its_speaker_and_gives_only_to_its_readers(
    network: Guarded,
) -> None:
    everybody = {role: network.session(role) for role in roles() if role != "router"}
    ears = {
        (role, name): Ear(session, key_of(name))
        for (role, session), name in itertools.product(everybody.items(), SPEAKERS)
    }
    for session in everybody.values():
        settle(session)
    for name, speaker in SPEAKERS.items():
        for role, session in everybody.items():
            session.put(key_of(name), f"{role} says".encode())
            settle(session)
        everybody[speaker].put(key_of(name), b"the end")
    # Who may not read a topic would hear it before this, which comes last and all may read.
    everybody["tracker"].put(key_of("health"), b"all said")
    for role in everybody:
        ears[role, "health"].wait(b"all said")
    for (role, name), ear in ears.items():
        speaker = SPEAKERS[name]
        says = {f"{one} says".encode() for one in {speaker, ALSO.get(name, speaker)} - {role}}
        # What a session says it hears itself, whatever the router thinks of it.
        from_others = set(ear.heard) - {f"{role} says".encode(), b"all said"}
        if role == speaker:
            assert from_others <= {b"the end"}, (role, name)
        elif may_read(role, BY_NAME[name]):
            assert from_others == {*says, b"the end"}, (role, name)
        else:
            assert from_others == set(), (role, name)


def test_health_of_a_peer_reaches_those_who_listen_to_all_health(network: Guarded) -> None:
    """A peer once was not told that somebody listens, and so said nothing."""
    planner = Ear(network.session("planner"), f"{PREFIX}/health/*/*")
    watchdog = network.bus("watchdog", "peer")
    health = msgspec.structs.replace(EXAMPLES["Health"], service="watchdog")
    end_s = time.monotonic() + WAIT_S
    while encode(health) not in planner.heard and time.monotonic() < end_s:
        watchdog.publish(health)
        planner.wait_briefly()
    assert encode(health) in planner.heard


def test_every_topic_says_who_publishes_it_and_somebody_may_read_it() -> None:
    for topic in TOPICS:
        assert any(may_publish(role, topic) for role in roles()), topic.name
        assert any(may_read(role, topic) for role in roles()), topic.name
        assert set(topic.readers.split()) <= {*roles(), "*"}, topic.name


def test_the_planner_hears_people_health_and_calibration_and_says_nothing() -> None:
    assert {topic.name for topic in TOPICS if may_read("planner", topic)} == PLANNER_HEARS
    assert not any(may_publish("planner", topic) for topic in TOPICS)
    assert not any(may_publish("operator", topic) for topic in TOPICS)


def test_pictures_go_to_few() -> None:
    for name, readers in PICTURES_GO_TO.items():
        assert {role for role in roles() if may_read(role, BY_NAME[name])} == readers


@pytest.mark.parametrize("service", SERVICES)
def test_every_service_may_read_its_inputs_and_publish_what_is_its(
    service: str, tmp_path: Path
) -> None:
    role = service.partition("-")[0]
    node = node_of(service, tmp_path)
    for kind in node.inputs:
        assert may_read(role, BY_MESSAGE[kind]), f"{role} is no reader of {kind.__name__}"
    node.close()


def test_raw_pictures_pass_only_where_they_do_not_leave_the_host() -> None:
    rules = access_control("cert_common_names")
    subjects = {subject["id"]: subject for subject in rules["subjects"]}
    for policy in rules["policies"]:
        (name,) = policy["subjects"]
        keys = {key for r in rules["rules"] if r["id"] in policy["rules"] for key in r["key_exprs"]}
        raw = {key for key in keys if key.endswith(("/rgbd", "/crops"))}
        assert not raw or subjects[name]["interfaces"] == ["lo"], name
