"""Readers of files and replies of other processes: checkpoints, plans, compose files, the time."""

import struct
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from common.runtime.assignment import read_header
from common.runtime.checkpoint import CheckpointStore
from common.transport.clock import ClockMonitor, TimeReply
from deploy import compose
from deploy.launcher.launcher import read_plan
from deploy.launcher.state import State
from people4d.codec import encode
from tests import ROOT
from tests.contract.examples import FULL
from tests.fuzz.target import Target

COMPOSE = ROOT / "deploy" / "compose.yaml"


def _files(data: bytes, folder: Path) -> None:
    """Read the files of a checkpoint: two states and a number, each after its length."""
    parts, rest = [], data
    for _ in range(2):
        size = int.from_bytes(rest[:2], "little")
        parts.append(rest[2 : 2 + size])
        rest = rest[2 + size :]
    names = ("a.state0.checkpoint", "a.state1.checkpoint", "a.next.checkpoint")
    for name, part in zip(names, (*parts, rest), strict=True):
        (folder / name).write_bytes(part)
    saved = CheckpointStore(folder, "a").read()
    if saved.next_number < 0:
        raise AssertionError("a number is negative")


def _files_seeds(folder: Path) -> Sequence[bytes]:
    store = CheckpointStore(folder, "a")
    for state in (b"first", b"second"):
        store.write_state(state)
    store.write_number(7)
    states = [(folder / f"a.state{i}.checkpoint").read_bytes() for i in (0, 1)]
    sized = b"".join(struct.pack("<H", len(state)) + state for state in states)
    return [sized + (folder / "a.next.checkpoint").read_bytes()]


def _plan(data: bytes, folder: Path) -> None:
    state = State(folder)
    state.run_file.write_bytes(data)
    state.plan_file.write_bytes(data)
    state.read()
    for service in read_plan(state):
        assert isinstance(service.instances, tuple)


def _compose(data: bytes, folder: Path) -> None:
    path = folder / "compose.yaml"
    path.write_bytes(data)
    compose.select(compose.read(path, {"A": "1"}), {"gait"})


def _header(data: bytes, _: Path) -> None:
    read_header(data)


class _Reply:
    """Bus that replies to each query with the same bytes."""

    def __init__(self, payload: bytes) -> None:
        self._payload = payload

    def query(self, name: str, on_reply: Callable[[bytes], None]) -> None:
        on_reply(self._payload)


def _time(data: bytes, _: Path) -> None:
    monitor = ClockMonitor(_Reply(data), "other", lambda: 10**18)
    monitor.query()
    monitor.gauges()


PLAN = compose.read(COMPOSE, {})

TARGETS = (
    Target("files of a checkpoint", _files, _files_seeds),
    Target(
        "plan of a run",
        _plan,
        lambda _: [msgspec.json.encode(PLAN), b'{"connect": "tcp/127.0.0.1:7447", "pid": 1}'],
        (b'"replicas":', b"-1", b"1e999"),
        max_bytes=16384,
    ),
    Target(
        "compose file",
        _compose,
        lambda _: [COMPOSE.read_bytes()],
        (b"!reset", b"!override", b"extends", b"<<: *a", b"&a", b"${A:-b}", b"$$"),
        max_bytes=16384,
    ),
    Target("header of a message", _header, lambda _: [encode(m) for m in FULL], (b"\xa6camera",)),
    Target(
        "reply of a clock",
        _time,
        lambda _: [msgspec.msgpack.encode(TimeReply("a", 10**18, 10**18 + 1))],
    ),
)
