"""Bad bytes on any topic end no process, and good messages after them are handled."""

import random
import threading
from collections.abc import Sequence
from pathlib import Path

import pytest
import zenoh

from common.runtime import heartbeat
from common.runtime.loop import Loop, LoopSettings
from common.transport.trace import ProcessId
from common.transport.zenoh_bus import read_config
from people4d.codec import encode
from people4d.messages import Health, Message
from people4d.topics import BY_MESSAGE, TOPICS, Topic
from tests.common.nodes import Echo
from tests.contract.examples import BY_NAME, FULL
from tests.network import WAIT_S, Network, Watcher
from tests.services import SERVICES, node_of

pytestmark = pytest.mark.network

OF_NAME = {topic.name: topic for topic in TOPICS}
BLOCK = zenoh.CongestionControl.BLOCK  # a busy machine drops messages that may be dropped


class All(Echo):
    """Receives all messages, and counts them by type."""

    inputs: tuple[type[Message], ...] = tuple(topic.message for topic in TOPICS)

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        self.handled.append(message.sequence)
        return ()


def bad_payloads(topic: Topic) -> list[bytes]:
    """Return payloads that may arrive instead of a message of a topic."""
    good, chance = encode(BY_NAME[topic.message.__name__]), random.Random(topic.name)
    foreign = next(message for message in FULL if type(message) is not topic.message)
    return [
        b"",
        good[: len(good) // 2],
        good[:-1],
        good + b"\x00",
        good.replace(b"\xa7version%c" % topic.message.VERSION, b"\xa7version\x7f"),
        good.replace(b"\xa8sequence", b"\xa8sequenze"),
        encode(foreign),
        b"\x91" * 5000,
        *(chance.randbytes(length) for length in (1, 100, 100_000)),
    ]


@pytest.mark.parametrize("service", ["all", *SERVICES])
def test_bad_payloads_are_counted_and_good_ones_handled_after_them(
    network: Network, service: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(heartbeat, "PERIOD_S", 0.05)
    node = All() if service == "all" else node_of(service, tmp_path)
    robot = network.robot()
    process_id = ProcessId(service, f"{service}-1", "host")
    loop = Loop(node, network.open(robot), process_id, LoopSettings(workers=2))
    watcher = Watcher(network.open(robot), Health)
    running = threading.Thread(target=loop.run)
    running.start()
    streams = [(BY_MESSAGE[kind], robot) for kind in node.inputs]
    streams += [(OF_NAME[t.name], t.key.split("/")[2]) for t in node.foreign_inputs]
    assert streams
    try:
        with zenoh.open(read_config(None, "client", network.environment)) as outside:
            watcher.wait(Health)
            health = send_all(outside, streams, watcher)
            assert health.reason
            received = {f"received_{topic.name}": 1 for topic, _ in streams}
            for topic, name in streams:
                message = BY_NAME[topic.message.__name__]
                outside.put(topic.key_of(message, name), encode(message), congestion_control=BLOCK)
            health = watcher.wait_for_counters(**received)
            assert health.counters.get("errors", 0) == 0
    finally:
        loop.stop()
        running.join(WAIT_S)
    assert not running.is_alive()
    last = watcher.wait(Health, lambda health: health.state == "stopping")
    assert last.counters.get("errors", 0) == 0
    if isinstance(node, All):
        assert set(node.handled) >= {message.sequence for message in FULL}


def send_all(
    outside: zenoh.Session, streams: Sequence[tuple[Topic, str]], watcher: Watcher
) -> Health:
    """Send every bad payload on every topic of a robot and wait until each was counted."""
    topics = [topic for topic, _ in streams]
    for number, payloads in enumerate(zip(*map(bad_payloads, topics), strict=True), 1):
        for (topic, name), payload in zip(streams, payloads, strict=True):
            key = topic.key_of(BY_NAME[topic.message.__name__], name)
            outside.put(key, payload, congestion_control=BLOCK)
        # One at a time: the newest frame replaces waiting ones, bad frames included.
        health = watcher.wait_for_counters(**{f"bad_{topic.name}": number for topic in topics})
    return health
