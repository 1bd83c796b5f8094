"""Diagnostics of a running system, from artificial messages."""

import re
from typing import Any

import numpy as np
import pytest

from common.diagnosis.checks import examine
from common.diagnosis.evidence import NAMES_MAX, Diagnostic, Evidence
from people4d.messages import Detection, Detections, Health, Track
from tests import builders

S = 10**9


def health(instance: str, **fields: Any) -> Health:
    service = instance.partition("-")[0]
    given: dict[str, Any] = {"stamp_ns": 0, "pid": 1, "host": "robot", "release": "1.0"}
    given |= {"sequence": 0, "service": service, "instance": instance, "state": "ready"} | fields
    return Health(**given)


def detections(*people: Detection, sequence: int = 0) -> Detections:
    return builders.detections(
        *people, stamp_ns=sequence, sequence=sequence, frame_id="optical", width=64, height=48
    )


PERSON = Detection(
    box_xyxy_px=np.array([1, 1, 9, 9], np.float32), score=0.9, position_m=np.array([0.0, 0.0, 2.0])
)
NOWHERE = Detection(box_xyxy_px=np.array([1, 1, 9, 9], np.float32), score=0.9)
TRACK = builders.track()

# One second of a system that works, by service: counters at its begin and at its end.
WORKS: dict[str, tuple[dict[str, int], dict[str, int]]] = {
    "router-1": ({}, {}),
    "camera-1": ({"sent_frames": 10}, {"sent_frames": 40}),
    "detector-1": (
        {"received_frames": 10, "frames": 10, "no_depth": 0},
        {"received_frames": 40, "frames": 40, "no_depth": 0},
    ),
    "tracker-1": ({"clock_resets": 0}, {"clock_resets": 0}),
}


Changes = dict[str, dict[str, Any]]


def degraded(reason: str, **values: Any) -> dict[str, Any]:
    return {"state": "degraded", "reason": reason, **values}


def gauges(**values: float) -> dict[str, Any]:
    return {"gauges": values}


class Heard:
    """A system that works, heard for a second; tests change what they cause."""

    def __init__(self) -> None:
        self.evidence = Evidence(robot="robot", release="1.0", elapsed_s=1.0)
        self.counters = {name: (dict(a), dict(b)) for name, (a, b) in WORKS.items()}
        self.fields: dict[str, dict[str, Any]] = {name: {} for name in WORKS}
        self.late_ns = 1_000_000
        self.people: tuple[Detection, ...] = (PERSON,)
        self.tracks: tuple[Track, ...] = (TRACK,)

    def count(self, instance: str, **counts: int) -> None:
        """Raise counters by these numbers while the doctor listens."""
        first, last = self.counters[instance]
        for name, count in counts.items():
            last[name] = first.get(name, 0) + count

    def change(self, changes: Changes) -> None:
        """Change services, which are added if absent: counters (int) rise, fields are set."""
        for service, values in changes.items():
            instance = f"{service}-1"
            self.counters.setdefault(instance, ({}, {}))
            counts = {name: value for name, value in values.items() if isinstance(value, int)}
            self.count(instance, **counts)
            self.fields[instance] = {k: v for k, v in values.items() if k not in counts}

    def diagnostics(self) -> list[Diagnostic]:
        for name, (first, last) in self.counters.items():
            for counters, stamp_ns in ((first, 0), (last, S)):
                heartbeat = health(
                    name, counters=counters, **({"stamp_ns": stamp_ns} | self.fields[name])
                )
                self.evidence.add_message(heartbeat, heartbeat.stamp_ns + self.late_ns)
        for number in range(30):
            self.evidence.add_message(detections(*self.people, sequence=number), 0)
            self.evidence.add_message(
                builders.tracks(stamp_ns=number, sequence=number, tracks=self.tracks), 0
            )
        present = [("robot", name.partition("-")[0], name) for name in self.counters]
        self.evidence.present = self.evidence.present or present
        return examine(self.evidence)

    def found(self, check: str) -> Diagnostic:
        """Return the diagnostic of a failed check."""
        (found,) = [f for f in self.diagnostics() if f.check == check and f.level != "ok"]
        assert found.hint
        return found


@pytest.fixture
def heard() -> Heard:
    return Heard()


def test_working_system_has_no_problem(heard: Heard) -> None:
    diagnostics = heard.diagnostics()
    assert {f.level for f in diagnostics} == {"ok"}
    what = {f.check: f.what for f in diagnostics}
    assert what["frames"] == "30 frames a second arrive"
    assert what["output"] == "30 messages about people a second, of up to 1 people"
    assert what["services"] == "camera, detector, router, tracker run"


def test_exceptions_of_a_process_are_a_problem_with_their_count(heard: Heard) -> None:
    reason = "the node failed (ValueError in node.py line 7): no, 40 in all"
    heard.change({"detector": degraded(reason)})
    heard.counters["detector-1"][0]["errors"] = 10
    heard.counters["detector-1"][1]["errors"] = 40
    found = heard.found("exceptions")
    assert found.level == "problem"
    assert found.what == f"detector-1 fails, 40 times since its start: {reason}"
    heard.counters["detector-1"][0]["errors"] = 40  # no error is recent
    assert heard.found("exceptions").level == "warning"


OWNER = "camera_info: another process sends people4d/v1/robot/camera/front/info than its owner"
DELAYS = {"camera_offset_front_ms": 0.0, "camera_offset_back_ms": 0.0, "camera_delay_front_ms": 0.0}


@pytest.mark.parametrize(
    ("check", "level", "what", "changes"),
    [
        (
            *("output", "warning", "... of up to 1 people, but 450 frames a second arrive"),
            {"camera": {"sent_frames": 450}},
        ),
        (
            *("owners", "warning"),
            "another process than the owner sends camera_info, static_transforms, "
            "refused by detector-1, tracker-1",
            {
                "detector": degraded(OWNER, foreign_camera_info=2),
                "tracker": {"foreign_camera_info": 2, "foreign_static_transforms": 1},
            },
        ),
        (
            *("release", "problem"),
            "...: 0.9: tracker-1; 1.0: here, router-1, detector-1; an older one: camera-1",
            {"tracker": {"release": "0.9"}, "camera": {"release": ""}},
        ),
        (  # 200 ms ahead of the reference, with an error of 3 ms
            *("clocks", "problem", "host clocks differ: nuc is 200 ms ahead"),
            {"camera": {"host": "nuc", **gauges(clock_offset_ms=200.0, clock_error_ms=3.0)}},
        ),
        (
            *("clocks", "warning"),
            "camera stamps differ, and are corrected: back is 500 ms behind",
            {"tracker": gauges(camera_offset_front_ms=0.0, camera_offset_back_ms=-500.0)},
        ),
        (  # Delays are relative to the first camera, whose own messages are late here.
            *("clocks", "warning", "messages of cameras arrive late: front by 300 ms"),
            {"tracker": gauges(**DELAYS, camera_delay_back_ms=-300.0)},
        ),
        (
            *("clocks", "problem", "a clock was set while tracker-1 ran"),
            {"tracker": {"clock_steps": 1}},
        ),
        (
            *("clocks", "warning", "stamps of frames jumped 2 times since..."),
            {"tracker": {"clock_resets": 2}},
        ),
        (
            *("ros2", "warning", "...s behind this machine's clock..."),
            {"ros2_bridge": gauges(stamps_behind_s=9e6)},
        ),
        (
            *("ros2", "warning", "...s ahead of this machine's clock..."),
            {"ros2_bridge": gauges(stamps_behind_s=-60.0)},
        ),
        (
            *("ros2", "problem", "people are not sent to ROS 2: people are 3.2 s behind"),
            {"ros2_bridge": degraded("people are 3.2 s behind", not_extrapolated=2)},
        ),
        (
            *("frames", "warning", "frames stop for more than 0.5 s..."),
            {"tracker": {"people_unknown": 2}},
        ),
        (
            *("frames", "problem", "camera-1 sends no frames: the source failed: unplugged"),
            {
                "camera": degraded("the source failed: unplugged", sent_frames=0),
                "detector": degraded("no frames for 5 s", received_frames=0),
            },
        ),
        (
            *("frames", "problem", "...do not reach the detector..."),
            {"detector": {"received_frames": 0}},
        ),
        (
            *("pairs", "problem", "...60 pictures, 40 pairs..."),
            {"camera": {"unpaired": 60, "sent_frames": 30}},
        ),
        (
            *("calibration", "problem", "...no CameraInfo arrives..."),
            {"detector": {"no_calibration": 30}},
        ),
        (
            *("calibration", "problem", "...expected 640x480, got 320x240..."),
            {"detector": degraded("expected 640x480, got 320x240", wrong_size=30)},
        ),
        (
            *("transform", "problem"),
            "no transform map <- optical: the camera is taken as the origin",
            {"tracker": degraded("no transform map <- optical: the camera is taken as the origin")},
        ),
        ("odometry", "warning", "...", {"tracker": {"predicted_base": 30}}),
        (
            *("depth", "problem", "...all zero in 30 of 30 frames..."),
            {"detector": {"no_depth": 30, "frames": 30}},
        ),
        (  # a heartbeat between both counts
            *("depth", "problem", "...all zero in 30 of 30 frames..."),
            {"detector": {"no_depth": 30, "frames": 29}},
        ),
        (
            *("model", "problem", "the model failed: burst"),
            {"detector": degraded("the model failed: burst", model_errors=5)},
        ),
        (
            *("load", "warning", "detector-1 is too slow: of 30 frames a second 19 are skipped"),
            {"detector": degraded("too slow: of 30 frames a second 19 are skipped")},
        ),
        (
            *("hanging", "problem", "detector-1 is stalled: busy with one message for 5 s"),
            {"detector": {"state": "stalled", "reason": "busy with one message for 5 s"}},
        ),
        (
            *("state", "warning", "tracker-1 is degraded: no state in /x (No space left)"),
            {"tracker": degraded("no state in /x (No space left)")},
        ),
    ],
)
def test_fault_is_reported_by_its_check_alone(
    heard: Heard, check: str, level: str, what: str, changes: Changes
) -> None:
    heard.change(changes)
    found = heard.found(check)
    assert found.level == level
    assert re.fullmatch(re.escape(what).replace(r"\.\.\.", ".*"), found.what), found.what
    assert {f.check for f in heard.diagnostics() if f.level != "ok"} == {check}


@pytest.mark.parametrize(
    "changes",
    [
        {"camera": gauges(clock_offset_ms=40.0, clock_error_ms=1.0)},
        {"camera": gauges(clock_offset_ms=200.0, clock_error_ms=180.0)},  # within the error bound
        {"tracker": gauges(**DELAYS, camera_delay_back_ms=140.0)},
        {"ros2_bridge": gauges(stamps_behind_s=0.2)},
        {"detector": {"no_depth": 2, "frames": 30}},  # an occasional frame is no fault
    ],
)
def test_small_values_are_no_fault(heard: Heard, changes: Changes) -> None:
    heard.change(changes)
    assert {f.level for f in heard.diagnostics()} == {"ok"}


def test_heartbeats_of_processes_without_a_token_are_a_warning(heard: Heard) -> None:
    heard.evidence.present = [("robot", name.partition("-")[0], name) for name in heard.counters]
    for number in range(5000):
        invented = health(f"detector-{number + 100}", state="degraded", reason="x")
        heard.evidence.add_message(invented, invented.stamp_ns)
    found = heard.found("unannounced")
    assert found.level == "warning"
    assert "and 4995 more" in found.what
    assert len(found.what) < 200
    assert [f for f in heard.diagnostics() if f.check == "state"] == []


def test_absent_service_is_a_problem(heard: Heard) -> None:
    del heard.counters["detector-1"]
    found = heard.found("services")
    assert found.level == "problem"
    assert found.what == "detector does not run; camera, router, tracker does"


def test_tracker_of_cameras_on_other_hosts_needs_none_here(heard: Heard) -> None:
    del heard.counters["camera-1"], heard.counters["detector-1"]
    heard.count("tracker-1", received_detections=30)
    assert not [f for f in heard.diagnostics() if f.level == "problem"]


def test_site_needs_no_camera(heard: Heard) -> None:
    heard.counters = {"site-1": ({}, {})}
    heard.fields = {"site-1": {}}
    assert not [f for f in heard.diagnostics() if f.level == "problem"]


def test_wrong_robot_name_is_a_problem(heard: Heard) -> None:
    heard.counters.clear()
    heard.evidence.present = [("left", "tracker", "tracker-1"), ("right", "camera", "camera-1")]
    found = heard.found("robot")
    assert found.what == "no robot is called robot; there is left, right"
    assert found.hint == "Add --robot left."


def test_process_with_token_but_no_heartbeat_hangs(heard: Heard) -> None:
    heard.evidence.present = [("robot", "reid", "reid-1")]
    assert heard.found("services").what == "reid-1 sent no heartbeat"


def test_two_trackers_are_a_problem(heard: Heard) -> None:
    heard.counters["tracker-9"] = ({}, {})
    heard.fields["tracker-9"] = {"host": "nuc", "pid": 77}
    found = heard.found("twice")
    assert "2 trackers publish people" in found.what
    assert "tracker-9 on nuc (process 77)" in found.what


def test_two_processes_of_one_name_are_a_problem(heard: Heard) -> None:
    heard.evidence.add_message(health("tracker-1", host="nuc", pid=77), 0)
    assert "several processes are named tracker-1" in heard.found("twice").what


def test_messages_of_another_version_are_reported(heard: Heard) -> None:
    heard.evidence.refused["people"] = 3
    heard.evidence.refusal = "Tracks: expected version 1, got 2"
    assert "(people): Tracks: expected version 1, got 2" in heard.found("release").what


def test_clocks_apart_without_a_reference_are_a_problem(heard: Heard) -> None:
    heard.late_ns = -2 * S  # the messages arrive two seconds before they were sent
    assert heard.found("clocks").what == "host clocks differ: robot is 2000 ms ahead"


def test_people_that_ros_cannot_use_are_a_problem(heard: Heard) -> None:
    reason = "nothing links the frame of people to odom on /tf"
    heard.counters["ros2_bridge-1"] = {}, {}
    heard.count("ros2_bridge-1", reader_unlinked=30, other_type=2)
    heard.fields["ros2_bridge-1"] = {"state": "degraded", "reason": reason}
    found = [one for one in heard.diagnostics() if one.check == "ros2"]
    assert [one.level for one in found] == ["problem", "warning"]
    assert reason in found[0].what
    assert "another type" in found[1].what


def test_messages_of_ros_that_cannot_be_read_are_reported_by_cause(heard: Heard) -> None:
    causes = ("bad_message", "other_type", "other_qos", "no_attachment", "tf_loops")
    heard.count("camera-1", **dict.fromkeys(causes, 3))
    found = [one for one in heard.diagnostics() if one.check == "ros2"]
    assert len(found) == len(causes)
    assert all(one.about == ("camera-1",) and one.hint for one in found)


def test_no_detection_no_position_and_no_track_are_reported_apart(heard: Heard) -> None:
    heard.people, heard.tracks = (), ()
    found = heard.found("people")
    assert (found.level, found.what) == ("warning", "the detector finds no person in 30 frames")
    nowhere = Heard()
    nowhere.people = (NOWHERE,)
    assert nowhere.found("people").what == "30 people are found, but none has a position"
    no_tracks = Heard()
    no_tracks.tracks = ()
    assert "no track is published" in no_tracks.found("people").what


def test_process_that_stops_properly_is_no_problem(heard: Heard) -> None:
    heard.evidence.add_message(health("report-1"), 0)
    heard.evidence.add_message(health("report-1", state="stopping"), 0)
    assert {f.level for f in heard.diagnostics()} == {"ok"}


def test_invented_cameras_and_frames_are_bounded() -> None:
    evidence = Evidence(robot="robot")
    for number in range(2000):
        evidence.add_message(builders.camera_info(camera=f"c{number}"), 0)
        evidence.add_message(builders.static_transform(np.eye(4), child=f"f{number}"), 0)
    assert len(evidence.infos) == len(evidence.transforms) == NAMES_MAX
