"""A router and sessions on the loopback interface, on a free port, without multicast."""

import contextlib
import itertools
import queue
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

import zenoh

from common.transport.ports import free_port
from common.transport.zenoh_bus import ZenohBus, read_config
from people4d.codec import decode
from people4d.errors import DecodeError
from people4d.messages import Health, Message
from people4d.topics import BY_MESSAGE, TOPICS

WAIT_S = 40.0
CONGESTED = "transport/link/tx/queue/congestion_control/drop"

M = TypeVar("M", bound=Message)
_robots = itertools.count(1)


class Network:
    """One router and the sessions opened through it; close ends them all.

    Args:
        patient: No message is dropped because a reader is slow, and no link because nothing comes
            for seconds, as on a machine that is busy with other tests; False: as shipped.
    """

    def __init__(self, patient: bool = True) -> None:
        self._patient = patient
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.environment = {"PEOPLE4D_CONNECT": self.endpoint}
        self._buses: list[ZenohBus] = []
        self.start_router()

    def start_router(self) -> None:
        """Open the router."""
        config = self._read_config("router", {"PEOPLE4D_LISTEN": self.endpoint})
        self._router = ZenohBus(config, "robot")

    def stop_router(self) -> None:
        """Close the router."""
        self._router.close()

    def robot(self) -> str:
        """Return a name of a robot that no other test has."""
        return f"robot{next(_robots)}"

    def open(self, robot: str, mode: str = "client", timeout_s: float = 0.0) -> ZenohBus:
        """Open a session."""
        bus = ZenohBus(self._read_config(mode, self.environment), robot, timeout_s)
        self._buses.append(bus)
        return bus

    def close(self) -> None:
        """Close everything."""
        for bus in self._buses:
            bus.close()
        self.stop_router()

    def _read_config(self, mode: str, environment: dict[str, str]) -> zenoh.Config:
        config = read_config(None, mode, environment)
        if self._patient:
            for name in ("wait_before_drop", "max_wait_before_drop_fragments"):  # [us]
                config.insert_json5(f"{CONGESTED}/{name}", str(int(WAIT_S * 1e6)))
            config.insert_json5("transport/link/tx/lease", str(int(WAIT_S * 1e3)))  # [ms]
        return config


class Watcher:
    """Collects the messages on a bus, with waits for them."""

    def __init__(self, bus: ZenohBus, *kinds: type[Message]) -> None:
        kinds = kinds or tuple(topic.message for topic in TOPICS)
        # Topics have no common order, so a wait for one topic must not skip messages of another.
        self._arrived: dict[type[Message], queue.Queue[Any]] = {k: queue.Queue() for k in kinds}
        for kind in kinds:
            subscription = bus.subscribe(BY_MESSAGE[kind])
            threading.Thread(target=self._receive, args=(subscription, kind), daemon=True).start()

    def wait(self, kind: type[M], condition: Callable[[M], Any] = lambda _: True) -> M:
        """Return the next message of a type that meets a condition; TimeoutError if none does."""
        end, message = time.monotonic() + WAIT_S, None
        while True:
            try:
                message = self._arrived[kind].get(timeout=max(end - time.monotonic(), 0.0))
            except queue.Empty:
                raise TimeoutError(f"no such {kind.__name__}; the last was {message}") from None
            if type(message) is kind and condition(message):
                found: M = message
                return found

    def wait_for_counters(self, **counters: int) -> Health:
        """Return the first heartbeat with counters not below these."""
        return self.wait(
            Health, lambda h: all(h.counters.get(n, -1) >= count for n, count in counters.items())
        )

    def _receive(self, subscription: Any, kind: type[Message]) -> None:
        for _, payload in subscription:
            with contextlib.suppress(DecodeError):  # tests also send bad bytes
                self._arrived[kind].put(decode(payload))
