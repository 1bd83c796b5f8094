"""Table of topics."""

import re

import msgspec
import pytest

from people4d.messages import Message
from people4d.topics import BY_MESSAGE, BY_NAME, TOPICS, prefix, topic_of_key
from tests.contract.examples import BY_NAME as EXAMPLES
from tests.contract.examples import FULL

IMAGES = {"RgbdFrame", "CompressedRgbdFrame", "Crops"}


def test_names_keys_and_messages_are_unique() -> None:
    assert len(BY_NAME) == len(BY_MESSAGE) == len({topic.key for topic in TOPICS}) == len(TOPICS)
    for name in BY_NAME:
        assert re.fullmatch("[a-z_]+", name)


def test_images_and_only_images_are_under_raw() -> None:
    # One access rule on raw/** must hide every image of a person.
    for topic in TOPICS:
        assert topic.key.startswith("raw/") == (topic.message.__name__ in IMAGES), topic.name


def test_named_fields_are_fields_of_the_message() -> None:
    for topic in TOPICS:
        named = [*re.findall(r"{([^}]*)}", topic.key), *(topic.lossless or ())[:1]]
        if topic.numbered != "key":
            named += [topic.numbered] if topic.numbered else []
        for name in named:
            assert name in topic.message.__struct_fields__, topic.name
        assert topic.depth >= 1


def test_keys_by_hand() -> None:
    frames, health = BY_NAME["frames"], BY_NAME["health"]
    assert frames.key_of(EXAMPLES["RgbdFrame"], "r2") == "people4d/v1/r2/raw/front/rgbd"
    assert frames.key_expression("r2") == "people4d/v1/r2/raw/*/rgbd"
    assert health.key_of(EXAMPLES["Health"], "r2") == "people4d/v1/r2/health/tracker/tracker-1"
    assert health.key_expression("r2") == "people4d/v1/r2/health/*/*"
    assert prefix("r2") == "people4d/v1/r2"


@pytest.mark.parametrize("message", FULL, ids=lambda message: type(message).__name__)
def test_topic_of_key_undoes_key_of(message: Message) -> None:
    topic = BY_MESSAGE[type(message)]
    key = topic.key_of(message, "robot")
    assert topic_of_key(key) is topic
    assert topic_of_key(key, "robot") is topic
    assert topic_of_key(key, "other") is None
    assert topic_of_key(key + "/more") is None
    assert topic_of_key(f"x/{key}") is None


def test_dots_in_a_name_match_only_themselves() -> None:
    info = msgspec.structs.replace(EXAMPLES["CameraInfo"], camera="a.b")
    key = BY_NAME["camera_info"].key_of(info, "robot.1")
    assert topic_of_key(key, "robot.1") is BY_NAME["camera_info"]
    assert topic_of_key(key, "robot-1") is None


def test_only_the_newest_topics_may_lose_messages() -> None:
    newest = {topic.name for topic in TOPICS if topic.delivery == "newest"}
    assert newest == {"frames", "compressed"}
    assert {topic.name for topic in TOPICS if topic.rate_hz == 0} == {
        topic.name for topic in TOPICS if topic.delivery == "latched"
    }


def test_bounds_are_larger_for_images_and_transforms_only() -> None:
    large = {topic.name for topic in TOPICS if topic.max_bytes == 64 * 2**20}
    assert large == {"frames", "compressed", "crops"}
    many = {topic.name for topic in TOPICS if topic.keys_max == 512}
    assert many == {"static_transforms", "moving_transforms"}


def test_only_people_and_detections_have_the_clock_of_a_camera() -> None:
    clocks = {t.name: t.clock_of(EXAMPLES[t.message.__name__]) for t in TOPICS}
    of_cameras = {name for name, camera in clocks.items() if camera}
    assert of_cameras == {"detections", "people", "predictions"}
    assert clocks["people"] == EXAMPLES["Tracks"].camera  # type: ignore[attr-defined]
