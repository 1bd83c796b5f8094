"""Three network namespaces of this machine as three hosts, one behind a link of any quality.

The router's host is 192.168.1.7. The tracker's host, 192.168.1.8, is linked to it by a virtual
cable. Two TUN devices and a thread between them link the planner's host, 192.168.1.9, since
not every kernel can delay and lose packets. The hosts have no other network and separate shared
memory, since frames in a common one would bypass the links.
"""

import contextlib
import fcntl
import heapq
import os
import random
import select
import shutil
import signal
import struct
import subprocess
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

TUN = Path("/dev/net/tun")
SHARED_MEMORY = Path("/dev/shm")
TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 0x1, 0x1000
MTU = 1500
STOP_S = 15.0
ADDRESSES = {"nuc": "192.168.1.7", "tracker": "192.168.1.8", "planner": "192.168.1.9"}


@dataclass(frozen=True)
class Link:
    """Quality of a wire, for each packet in each direction.

    Args:
        delay_s: Delay of a packet [s].
        loss: Share of lost packets, 0 to 1.
        rate_bps: Bits a second.
        queue_s: Maximum wait of a packet for earlier packets [s]; later ones are lost.
        up: False if all packets are lost.
    """

    delay_s: float = 0.0
    loss: float = 0.0
    rate_bps: float = 1e9
    queue_s: float = 0.1
    up: bool = True


class Wire:
    """Two TUN devices, and a thread that carries packets between them.

    Args:
        names: Names of the devices.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.link = Link()
        self._ends = [_open_tun(name) for name in names]
        self._free_s = [0.0, 0.0]  # time at which each direction is free
        self._waiting: list[tuple[float, int, int, bytes]] = []
        self._chance = random.Random(0)
        self._stop, self._stopped = os.pipe()
        self._thread = threading.Thread(target=self._carry, name="wire")
        self._thread.start()

    def close(self) -> None:
        """End the thread and remove the devices."""
        os.close(self._stopped)
        self._thread.join()
        for end in (*self._ends, self._stop):
            os.close(end)

    def _carry(self) -> None:
        count = 0
        while True:
            now_s = time.monotonic()
            while self._waiting and self._waiting[0][0] <= now_s:
                _, _, end, packet = heapq.heappop(self._waiting)
                with contextlib.suppress(OSError):  # the host of the link has ended
                    os.write(self._ends[end], packet)
            wait_s = self._waiting[0][0] - now_s if self._waiting else None
            ready, _, _ = select.select([*self._ends, self._stop], [], [], wait_s)
            if self._stop in ready:
                return
            for descriptor in ready:
                packet = os.read(descriptor, MTU + 64)
                count += 1
                self._take(1 - self._ends.index(descriptor), packet, count)

    def _take(self, to: int, packet: bytes, number: int) -> None:
        link, now_s = self.link, time.monotonic()
        starts_s = max(self._free_s[to], now_s)
        if not link.up or starts_s - now_s > link.queue_s or self._chance.random() < link.loss:
            return
        self._free_s[to] = starts_s + len(packet) * 8 / link.rate_bps
        heapq.heappush(self._waiting, (self._free_s[to] + link.delay_s, number, to, packet))


class Hosts:
    """Runs commands on the three hosts.

    Args:
        wire: The link between the router's host and the planner's.
        names: Name of the namespace of each host, and of the folder that is its shared memory.
    """

    def __init__(self, wire: Wire, names: Mapping[str, str]) -> None:
        self.wire = wire
        self._names = names

    def start(self, host: str, command: Sequence[str], **options: Any) -> subprocess.Popen[str]:
        """Start a command on a host, in its own process group."""
        return subprocess.Popen(
            self._inside(host, command), text=True, start_new_session=True, **options
        )

    def run(self, host: str, command: Sequence[str], **options: Any) -> str:
        """Run a command on a host and return its output."""
        options = {"timeout": 120.0} | options
        return subprocess.run(
            self._inside(host, command), text=True, check=True, capture_output=True, **options
        ).stdout

    def _inside(self, host: str, command: Sequence[str]) -> list[str]:
        name = self._names[host]
        own = f'mount --bind {SHARED_MEMORY / name} {SHARED_MEMORY} && exec "$@"'
        return ["ip", "netns", "exec", name, "sh", "-c", own, "sh", *command]


def missing() -> str:
    """Return the reason if namespaces are impossible here, else an empty string."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    if not shutil.which("ip"):
        return "network namespaces need the command ip (iproute2)"
    if not TUN.exists():
        return f"the wire between namespaces needs {TUN}"
    name = f"p4d{os.getpid()}try"
    made = subprocess.run(["ip", "netns", "add", name], capture_output=True, check=False)
    if made.returncode:
        return f"no network namespace can be made: {made.stderr.decode().strip()}"
    _ip("netns", "del", name)
    return ""


@contextlib.contextmanager
def hosts() -> Iterator[Hosts]:
    """Create three hosts, removed with all their processes after the block."""
    mark = f"p4d{os.getpid()}"
    names = {host: f"{mark}-{host}" for host in ADDRESSES}
    with contextlib.ExitStack() as stack:
        for name in names.values():
            _ip("netns", "add", name)
            stack.callback(_ip, "netns", "del", name)
            stack.callback(_end_all, name)
            (SHARED_MEMORY / name).mkdir()
            stack.callback(shutil.rmtree, SHARED_MEMORY / name)
            _ip("-n", name, "link", "set", "lo", "up")
        _ip("link", "add", f"{mark}a", "type", "veth", "peer", "name", f"{mark}b")
        _connect(names["nuc"], f"{mark}a", "eth0", "nuc", "tracker")
        _connect(names["tracker"], f"{mark}b", "eth0", "tracker", "nuc")
        wire = Wire((f"{mark}c", f"{mark}d"))
        stack.callback(wire.close)
        _connect(names["nuc"], f"{mark}c", "wlan0", "nuc", "planner")
        _connect(names["planner"], f"{mark}d", "wlan0", "planner", "nuc")
        yield Hosts(wire, names)


def stop(process: "subprocess.Popen[str]") -> None:
    """End a process as Ctrl-C does."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _connect(namespace: str, device: str, name: str, host: str, other: str) -> None:
    """Move a device into a namespace, with the address of its host and a way to the other."""
    _ip("link", "set", device, "netns", namespace)
    inside = ("-n", namespace)
    _ip(*inside, "link", "set", device, "name", name, "mtu", str(MTU), "up")
    _ip(*inside, "address", "add", f"{ADDRESSES[host]}/32", "dev", name)
    _ip(*inside, "route", "add", ADDRESSES[other], "dev", name, "src", ADDRESSES[host])


def _end_all(namespace: str) -> None:
    """End all processes in a created namespace."""
    listed = subprocess.run(
        ["ip", "netns", "pids", namespace], capture_output=True, text=True, check=False
    )
    for pid in map(int, listed.stdout.split()):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def _open_tun(name: str) -> int:
    descriptor = os.open(TUN, os.O_RDWR)
    fcntl.ioctl(descriptor, TUNSETIFF, struct.pack("16sH22x", name.encode(), IFF_TUN | IFF_NO_PI))
    return descriptor


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True)
