"""A router that requires credentials, and sessions with credentials of any role."""

import contextlib
import threading
from collections.abc import Iterator
from pathlib import Path

import zenoh

from common.transport.access import roles
from common.transport.ports import free_port
from common.transport.zenoh_bus import ZenohBus, read_config
from deploy import keys
from people4d.topics import prefix

ROBOT = "robot"
PREFIX = prefix(ROBOT)
WAIT_S = 10.0


class Guarded:
    """A router with access rules, and the folder with the credentials of all roles.

    Args:
        folder: Folder of the credentials.
        passwords: Passwords in place of certificates.
        local: Interfaces on which topics pass that do not leave the host.
    """

    def __init__(self, folder: Path, passwords: bool = False, local: str = "lo") -> None:
        hosts = {"all": roles()}
        if passwords:
            keys.write_passwords(folder, hosts)
        else:
            keys.write_certificates(folder, hosts, ["127.0.0.1"], days=1)
        self.keys = folder / "all"
        self.port = free_port()
        self.local = local
        self._open = contextlib.ExitStack()
        listen = {"PEOPLE4D_LISTEN": f"tcp/127.0.0.1:{self.port}"}
        router = read_config(None, "router", self.environment() | listen, "router")
        self._open.callback(ZenohBus(router, ROBOT).close)

    def environment(self, folder: Path | None = None) -> dict[str, str]:
        """Return the variables of a process with a folder of credentials."""
        return {
            "PEOPLE4D_CONNECT": f"tcp/127.0.0.1:{self.port}",
            "PEOPLE4D_KEYS": str(folder or self.keys),
            "PEOPLE4D_LOCAL_INTERFACES": self.local,
        }

    def bus(
        self, role: str, mode: str = "client", folder: Path | None = None, timeout_s: float = 5.0
    ) -> ZenohBus:
        """Open our bus with the credentials of a role."""
        config = read_config(None, mode, self.environment(folder), role)
        bus = ZenohBus(config, ROBOT, timeout_s)
        self._open.callback(bus.close)
        return bus

    def session(self, role: str) -> zenoh.Session:
        """Open a bare session with the credentials of a role, which may try anything."""
        config = read_config(None, "client", self.environment(), role)
        return self._open.enter_context(zenoh.open(config))

    def close(self) -> None:
        """Close everything."""
        self._open.close()


@contextlib.contextmanager
def guarded(folder: Path, passwords: bool = False, local: str = "lo") -> Iterator[Guarded]:
    """Run a guarded router until the block ends."""
    network = Guarded(folder, passwords, local)
    try:
        yield network
    finally:
        network.close()


class Listener:
    """Collects the messages of a key expression, to be waited for."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.received: list[bytes] = []
        self._changed = threading.Condition()
        # In the session's thread: by default each subscriber has a thread, and there is no order
        # between the messages of two subscribers.
        callback = zenoh.handlers.Callback(self._receive, indirect=False)
        self._subscriber = session.declare_subscriber(key, callback)

    def _receive(self, sample: zenoh.Sample) -> None:
        with self._changed:
            self.received.append(sample.payload.to_bytes())
            self._changed.notify_all()

    def wait(self, payload: bytes) -> None:
        """Wait until a payload was received."""
        with self._changed:
            assert self._changed.wait_for(lambda: payload in self.received, WAIT_S), (
                f"no {payload!r}"
            )

    def wait_briefly(self) -> None:
        """Wait until another message is received, a tenth of a second at most."""
        with self._changed:
            self._changed.wait(0.1)


def settle(session: zenoh.Session) -> None:
    """Wait until the router has received all that a session sent, by a query to it.

    The session's listeners have then received all that the router sent to it before the reply.
    Queries and replies stay behind messages sent before. All roles may query health.
    """
    for _ in session.get(f"{PREFIX}/health/none/none"):
        raise AssertionError("a process that does not exist replied")
