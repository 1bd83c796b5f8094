"""Enrolled people are followed by name, expire, are forgotten, and never confused with others."""

import dataclasses
import stat
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.io.packed import pack
from common.runtime.node import LoopCallbacks
from people4d.errors import ConfigError
from people4d.messages import Target, TargetCommand
from services.target.build import build
from services.target.config import TargetConfig
from services.target.enrolment import DAY_NS, FILE, Enrolled, EnrolledFile, Enrolment
from services.target.node import TargetNode
from tests.target.scene import BLUE, GREEN, RED, Scene

VIEWS = [np.array([1.0, 0.0])]
EMBEDDER = ("test", 2)


def node_in(folder: Path, days: float = 30.0) -> TargetNode:
    node = build(TargetConfig(enrolment_days=days))
    node.attach(LoopCallbacks(state_folder=folder))
    return node


def ask(scene: Scene, action: Any, name: str, people: Any) -> Target:
    """Return the answer to a command about a name."""
    command = TargetCommand(stamp_ns=time.time_ns(), sequence=0, action=action, name=name)
    scene.node.handle(command, 0)
    target = scene.frame(people)
    if action != "name":
        assert target.answered_ns == command.stamp_ns
    return target


def enrolled(folder: Path) -> Scene:
    """Return a scene with person 1 locked, and enrolled as anna."""
    scene = Scene(node_in(folder))
    scene.choose(id=1)
    people = {1: (3.0, 0.0, RED), 2: (5.0, 2.0, BLUE)}
    assert scene.frames(10, people).state == "locked"
    assert ask(scene, "enrol", "anna", people).problem == ""
    return scene


def next_day(folder: Path, **fields: Any) -> Scene:
    """Return a scene of a new process without a checkpoint."""
    return Scene(node_in(folder, **fields), stamp_ns=10**15)


def test_enrolled_person_is_followed_by_name_in_another_process(tmp_path: Path) -> None:
    enrolled(tmp_path)
    assert stat.S_IMODE((tmp_path / FILE).stat().st_mode) == 0o600
    scene, people = next_day(tmp_path), {8: (4.0, 1.0, BLUE), 9: (3.0, 0.0, RED)}
    ask(scene, "name", "anna", people)
    assert scene.frames(10, people).id == 9


def test_person_in_view_before_the_choice_by_name_is_locked(tmp_path: Path) -> None:
    enrolled(tmp_path)
    scene, people = next_day(tmp_path), {9: (3.0, 0.0, RED)}
    scene.frames(20, people)
    ask(scene, "name", "anna", people)
    assert scene.frames(10, people).id == 9


@pytest.mark.parametrize("appearance", [BLUE, GREEN, 25.0])
def test_absent_enrolled_person_is_not_confused_with_another(
    tmp_path: Path, appearance: float
) -> None:
    # At 25 degrees the distance is 0.09, and an unknown person is expected at 0.14.
    enrolled(tmp_path)
    scene, people = next_day(tmp_path), {7: (3.0, 0.0, appearance), 8: (5.0, 2.0, BLUE)}
    ask(scene, "name", "anna", people)
    assert {scene.frame(people).id for _ in range(100)} == {None}


def test_choice_by_name_outlives_the_process(tmp_path: Path) -> None:
    enrolled(tmp_path)
    scene = next_day(tmp_path)
    ask(scene, "name", "anna", {8: (4.0, 1.0, BLUE)})
    node = node_in(tmp_path)
    node.restore(scene.node.save(), 0)
    assert Scene(node, scene.stamp_ns).frames(10, {9: (3, 0, RED)}).id == 9


def test_forgotten_person_is_not_followed_and_leaves_no_file_and_no_state(tmp_path: Path) -> None:
    scene = enrolled(tmp_path)
    target = ask(scene, "forget", "anna", {1: (3.0, 0.0, RED)})
    assert (target.state, target.problem, target.stop) == ("none", "", True)
    assert not (tmp_path / FILE).exists()
    assert len(scene.node.save()) < 1000
    assert ask(scene, "name", "anna", {1: (3.0, 0.0, RED)}).state == "none"


def test_unknown_name_is_reported(tmp_path: Path) -> None:
    scene = next_day(tmp_path)
    people = {1: (3.0, 0.0, RED)}
    assert ask(scene, "forget", "bob", people).problem == "bob is not enrolled"
    target = ask(scene, "name", "bob", people)
    assert (target.state, target.reason) == ("none", "no person is chosen: bob is not enrolled")


def test_enrolment_needs_a_locked_person(tmp_path: Path) -> None:
    scene = next_day(tmp_path)
    target = ask(scene, "enrol", "anna", {1: (3.0, 0.0, RED)})
    assert target.problem == "no person is locked: choose one with people4d follow ID"
    assert not (tmp_path / FILE).exists()


def test_enrolment_is_off_by_default(tmp_path: Path) -> None:
    assert TargetConfig().enrolment_days == 0
    scene = next_day(tmp_path, days=0.0)
    scene.choose(id=1)
    people = {1: (3.0, 0.0, RED)}
    scene.frames(10, people)
    assert "target.enrolment_days" in ask(scene, "enrol", "anna", people).problem
    assert "target.enrolment_days" in ask(scene, "name", "anna", people).reason
    assert not (tmp_path / FILE).exists()


def test_enrolled_person_can_be_forgotten_while_enrolment_is_off(tmp_path: Path) -> None:
    enrolled(tmp_path)
    scene = next_day(tmp_path, days=0.0)
    assert ask(scene, "forget", "anna", {}).problem == ""
    assert not (tmp_path / FILE).exists()


def test_person_enrolled_with_another_embedder_is_refused(tmp_path: Path) -> None:
    Enrolment(tmp_path / FILE, 30.0).enrol("anna", ("other", 2), VIEWS)
    scene, people = next_day(tmp_path), {1: (3.0, 0.0, RED)}
    target = ask(scene, "name", "anna", people)
    assert target.state == "none"
    assert target.reason == (
        "no person is chosen: anna is enrolled with the embedder other of length 2: enrol again"
    )
    assert {scene.frame(people).id for _ in range(20)} == {None}


def test_expired_person_is_deleted(tmp_path: Path) -> None:
    now_ns = [0]
    enrolment = Enrolment(tmp_path / FILE, 2.0, lambda: now_ns[0])
    assert enrolment.enrol("anna", EMBEDDER, VIEWS) == ""
    now_ns[0] = DAY_NS
    assert enrolment.enrol("bob", EMBEDDER, VIEWS) == ""
    now_ns[0] = 2 * DAY_NS
    assert enrolment.find("anna") == (None, "anna is not enrolled")
    assert enrolment.find("bob")[0]
    Enrolment(tmp_path / FILE, 0.0, lambda: 3 * DAY_NS)  # a start deletes expired people, too
    assert not (tmp_path / FILE).exists()


LONG = Enrolled(EMBEDDER, [np.array([3.0, 0.0])], 2**62)
SHORT = Enrolled(EMBEDDER, [np.array([1.0])], 2**62)
NONE = Enrolled(EMBEDDER, [], 2**62)


@pytest.mark.parametrize(
    "content",
    [b"damaged", *(pack(EnrolledFile({"anna": one})) for one in (LONG, SHORT, NONE))],
    ids=["bytes", "long", "short", "none"],
)
def test_damaged_file_is_reported_and_others_are_followed(tmp_path: Path, content: bytes) -> None:
    (tmp_path / FILE).write_bytes(content)
    scene, people = Scene(node_in(tmp_path)), {1: (3.0, 0.0, RED)}
    status = scene.node.status()
    assert status.state == "degraded"
    assert status.reason.endswith("is damaged: delete it, and enrol its people again")
    assert status.reason in ask(scene, "name", "anna", people).reason
    scene.choose(id=1)
    assert scene.frames(10, people).state == "locked"
    for action in ("enrol", "forget"):
        assert ask(scene, action, "anna", people).problem == status.reason
    (tmp_path / FILE).unlink()
    assert ask(scene, "enrol", "anna", people).problem == ""
    assert scene.node.status().state == "ready"


def test_name_of_another_person_is_not_overwritten(tmp_path: Path) -> None:
    scene = enrolled(tmp_path)
    people = {1: (3.0, 0.0, RED), 2: (5.0, 2.0, BLUE)}
    assert ask(scene, "enrol", "anna", people).problem == ""  # newer views of person 1
    scene.choose(id=2)
    assert scene.frames(10, people).id == 2
    refused = "anna is enrolled already: people4d forget anna"
    assert ask(scene, "enrol", "anna", people).problem == refused


def test_command_is_answered_at_once_without_frames(tmp_path: Path) -> None:
    scene = enrolled(tmp_path)
    command = TargetCommand(stamp_ns=5, sequence=0, action="forget", name="anna")
    assert scene.node.handle(command, 900_000_000) == ()  # the next frame answers
    for node, problem in ((scene.node, "anna is not enrolled"), (node_in(tmp_path), "")):
        if not problem:
            enrolled(tmp_path)
        (target,) = node.handle(command, 2_000_000_000)
        assert isinstance(target, Target)
        assert (target.answered_ns, target.problem, target.stop) == (5, problem, True)


def test_person_has_one_name(tmp_path: Path) -> None:
    scene = enrolled(tmp_path)
    refused = "this person is enrolled as anna: people4d forget anna"
    assert ask(scene, "enrol", "bob", {1: (3.0, 0.0, RED)}).problem == refused
    assert ask(scene, "forget", "bob", {1: (3.0, 0.0, RED)}).problem == "bob is not enrolled"


def test_enrolment_needs_a_state_folder() -> None:
    with pytest.raises(ConfigError, match="PEOPLE4D_STATE"):
        build(TargetConfig(enrolment_days=1.0)).attach(
            dataclasses.replace(LoopCallbacks(), state_folder=None)
        )


def test_file_holds_at_most_64_people(tmp_path: Path) -> None:
    enrolment = Enrolment(tmp_path / FILE, 1.0)
    assert {enrolment.enrol(f"p{k}", EMBEDDER, VIEWS) for k in range(64)} == {""}
    assert enrolment.enrol("more", EMBEDDER, VIEWS) == "64 people are enrolled: forget one first"
    assert enrolment.enrol("p1", EMBEDDER, VIEWS) == ""
