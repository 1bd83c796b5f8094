"""Evidence: messages of a running system, collected over a few seconds; and diagnostics."""

import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import msgspec

from common.runtime.heartbeat import release
from people4d.client import Client
from people4d.messages import CameraInfo, Detections, Health, Message, StaticTransform, Tracks

Level = Literal["ok", "warning", "problem"]
NAMES_MAX = 256  # maximum number of cameras, and of frames
HEARD = (Health, CameraInfo, StaticTransform, Detections, Tracks)


class Diagnostic(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one check."""

    check: str  # name of the check, one word
    level: Level = "ok"  # severity; "warning": people are published, with limits
    what: str  # finding, one sentence
    hint: str = ""  # remedy, one sentence; empty if none is needed
    about: tuple[str, ...] = ()  # processes whose state the finding explains


def ok(check: str, what: str) -> Diagnostic:
    """Return a diagnostic without a fault."""
    return Diagnostic(check=check, what=what)


def warning(check: str, what: str, hint: str, *about: str) -> Diagnostic:
    """Return a diagnostic of a limit."""
    return Diagnostic(check=check, level="warning", what=what, hint=hint, about=about)


def problem(check: str, what: str, hint: str, *about: str) -> Diagnostic:
    """Return a diagnostic of a fault that prevents people from being published."""
    return Diagnostic(check=check, level="problem", what=what, hint=hint, about=about)


@dataclass(slots=True)
class Vitals:
    """The heartbeats of one process."""

    first: Health  # first heartbeat
    last: Health  # last heartbeat
    late_ns: int  # minimum time from the stamp of a heartbeat to its arrival, by this host's clock
    # hosts and process numbers with this name
    pids: set[tuple[str, int]] = field(default_factory=set)

    @property
    def fault(self) -> str:
        """Reason of a process that is not ready; empty if it is."""
        return "" if self.last.state == "ready" else self.last.reason or f"it is {self.last.state}"

    def total(self, *names: str) -> int:
        """Return the number of events since the start of the process."""
        return sum(self.last.counters.get(name, 0) for name in names)

    def since(self, *names: str) -> int:
        """Return the number of events during the observation."""
        return self.total(*names) - sum(self.first.counters.get(name, 0) for name in names)


@dataclass(slots=True)
class Evidence:
    """Messages of a system, received over a few seconds."""

    robot: str  # name of the observed robot
    release: str = field(default_factory=release)  # release of people4d here
    elapsed_s: float = 0.0  # duration of the observation [s]
    vitals: dict[str, Vitals] = field(default_factory=dict)  # processes by name
    # robot, service and process of all liveliness tokens, of all robots
    present: list[tuple[str, str, str]] = field(default_factory=list)
    infos: dict[str, CameraInfo] = field(default_factory=dict)  # calibrations by camera
    # transforms by child frame
    transforms: dict[str, StaticTransform] = field(default_factory=dict)
    detections: list[Detections] = field(default_factory=list)  # detections by camera
    tracks: list[Tracks] = field(default_factory=list)  # people messages
    # messages that could not be read, by topic
    refused: Counter[str] = field(default_factory=Counter)
    refusal: str = ""  # reason why the last of these could not be read

    def of_service(self, service: str) -> list[Vitals]:
        """Return the processes of a service."""
        return [v for v in self.vitals.values() if v.last.service == service]

    def add_message(self, message: Message, now_ns: int) -> None:
        """Add a message; `now_ns` is the wall clock of this host."""
        if isinstance(message, Health):
            self._add_heartbeat(message, now_ns - message.stamp_ns)
        elif isinstance(message, CameraInfo):
            if _has_room(self.infos, message.camera):
                self.infos[message.camera] = message
        elif isinstance(message, StaticTransform):
            if _has_room(self.transforms, message.child):
                self.transforms[message.child] = message
        elif isinstance(message, Detections):
            self.detections.append(message)
        elif isinstance(message, Tracks):
            self.tracks.append(message)

    def _add_heartbeat(self, health: Health, late_ns: int) -> None:
        if health.state == "stopping":
            self.vitals.pop(health.instance, None)
            return
        vitals = self.vitals.setdefault(health.instance, Vitals(health, health, late_ns))
        vitals.last, vitals.late_ns = health, min(vitals.late_ns, late_ns)
        vitals.pids.add((health.host, health.pid))


def _has_room(known: Mapping[str, object], name: str) -> bool:
    return name in known or len(known) < NAMES_MAX


def listen(client: Client, seconds: float) -> Evidence:
    """Listen to a system for some seconds; heartbeats come twice a second."""
    evidence = Evidence(robot=client.session.robot)
    start_s = time.monotonic()
    for message in client.messages(*HEARD, timeout_s=seconds):
        evidence.add_message(message, time.time_ns())
        if time.monotonic() > start_s + seconds:
            break
    evidence.elapsed_s = time.monotonic() - start_s
    evidence.present = client.session.present()
    for name, count in client.queue.counters.items():
        if name.startswith("bad_"):
            evidence.refused[name.removeprefix("bad_")] = count
    evidence.refusal = client.queue.last_error
    return evidence
