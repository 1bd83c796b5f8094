"""Report the addresses that a command and its processes use, and the files that they leave.

    python -m scripts.outward people4d demo --report out/demo

Lists addresses beyond this machine that a process connects, sends or binds to, name servers that it
queries, and files in its initially empty home folder except the state folder of people4d. The exit
code is 1 if there are any. It needs Linux 5.5 and no privileges: the command inherits a seccomp
filter, by which the kernel reports these calls of Python and of native libraries. Calls through
io_uring are not reported.
"""

import contextlib
import ctypes
import fcntl
import ipaddress
import os
import platform
import select
import socket
import struct
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

MACHINES = {  # numbers of the machine and of its system calls in the kernel
    "x86_64": (
        0xC000003E,
        {"seccomp": 317, "connect": 42, "sendto": 44, "sendmsg": 46, "bind": 49, "sendmmsg": 307},
    ),
    "aarch64": (
        0xC00000B7,
        {
            "seccomp": 277,
            "connect": 203,
            "sendto": 206,
            "sendmsg": 211,
            "bind": 200,
            "sendmmsg": 269,
        },
    ),
}
NO_NEW_PRIVILEGES, SET_FILTER, IS_AVAILABLE, NEW_LISTENER = 38, 1, 2, 8
ALLOW, NOTIFY, CONTINUE = 0x7FFF0000, 0x7FC00000, 1
LOAD, EQUAL, RETURN = 0x20, 0x15, 0x06  # instructions of a filter
NUMBER, MACHINE, TARGET = 0, 4, 48  # offsets of a call's number, machine and fifth argument
RECEIVE, SEND = 0xC0502100, 0xC0182101
NAME_SERVER = 53  # port of name servers
RESOLVER = b"/run/systemd/resolve/"
MESSAGES_MAX = 1024  # maximum number of messages of one call
PROGRAM_MAX = 80  # maximum number of characters
STATE = ".local/state/people4d"


@dataclass(frozen=True, order=True)
class Contact:
    """Address that a process gave to the kernel."""

    call: str  # "connect", "send" or "bind"
    address: str
    port: int
    program: str  # command line

    @property
    def outward(self) -> bool:
        """True beyond this machine, and for a name server."""
        if self.port == NAME_SERVER or self.address.startswith("/"):
            return True
        ip = ipaddress.ip_address(self.address.removeprefix("::ffff:"))
        return not (ip.is_loopback or (ip.is_unspecified and self.call != "bind"))

    def __str__(self) -> str:
        """Return the contact as one line."""
        return f"{self.call} {self.address} port {self.port}: {self.program}"


def missing() -> str:
    """Return the reason if commands cannot be watched here, else an empty string."""
    if sys.platform != "linux" or platform.machine() not in MACHINES:
        return f"{sys.platform} on {platform.machine()} has no such filter"
    action = ctypes.c_uint32(NOTIFY)
    number = MACHINES[platform.machine()][1]["seccomp"]
    if ctypes.CDLL(None).syscall(number, IS_AVAILABLE, 0, ctypes.byref(action)):
        return "this kernel cannot report calls"
    return ""


def watch(
    command: Sequence[str], environment: Mapping[str, str] = os.environ
) -> tuple[int, set[Contact]]:
    """Run a command until all its processes have ended; return its exit code and its contacts."""
    descriptors: list[int] = []
    codes: list[int] = []
    installed = threading.Event()

    def run() -> None:
        try:
            descriptors.append(_install())  # for this thread and the processes that it starts
        finally:
            installed.set()
        codes.append(subprocess.run(command, env=environment, check=False).returncode)

    thread = threading.Thread(target=run)
    thread.start()
    installed.wait()
    found = {contact for one in descriptors for contact in _contacts(one)}
    thread.join()
    return codes[0], found


def left_files(home: Path) -> list[str]:
    """Return the files below a home folder that are not in the state folder of people4d."""
    files = (path.relative_to(home) for path in home.rglob("*") if not path.is_dir())
    return sorted(str(path) for path in files if not path.is_relative_to(STATE))


def homeless(home: Path) -> dict[str, str]:
    """Return the environment of a process with another home folder."""
    return {k: v for k, v in os.environ.items() if not k.startswith("XDG_")} | {"HOME": str(home)}


def _install() -> int:
    """Install the filter in this thread; return the descriptor at which calls are reported."""
    machine, calls = MACHINES[platform.machine()]
    filters = [(LOAD, 0, 0, MACHINE), (EQUAL, 1, 0, machine), (RETURN, 0, 0, ALLOW)]
    filters += [(LOAD, 0, 0, NUMBER), (EQUAL, 0, 4, calls["sendto"]), (LOAD, 0, 0, TARGET)]
    filters += [(EQUAL, 0, 1, 0), (RETURN, 0, 0, ALLOW), (RETURN, 0, 0, NOTIFY)]  # 0: connected
    for name in ("connect", "bind", "sendmsg", "sendmmsg"):
        filters += [(EQUAL, 0, 1, calls[name]), (RETURN, 0, 0, NOTIFY)]
    filters.append((RETURN, 0, 0, ALLOW))
    code = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *one) for one in filters))
    head = ctypes.create_string_buffer(
        struct.pack("HxxxxxxQ", len(filters), ctypes.addressof(code))
    )
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    descriptor = libc.syscall(calls["seccomp"], SET_FILTER, NEW_LISTENER, head)
    if descriptor < 0:
        raise OSError(ctypes.get_errno(), "the filter cannot be installed")
    return int(descriptor)


def _contacts(descriptor: int) -> Iterator[Contact]:
    """Yield the contacts of all processes with the filter, until the last has ended."""
    names = {number: name for name, number in MACHINES[platform.machine()][1].items()}
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    while not poll.poll()[0][1] & select.POLLHUP:
        report = bytearray(80)
        with contextlib.suppress(OSError):  # the process was ended meanwhile
            fcntl.ioctl(descriptor, RECEIVE, report)
            identity, pid, _, number, _, _, *arguments = struct.unpack("QIIiIQ6Q", report)
            with contextlib.suppress(OSError):
                yield from _contacts_of(names[number], pid, arguments)
            fcntl.ioctl(descriptor, SEND, struct.pack("QqiI", identity, 0, 0, CONTINUE))


def _contacts_of(name: str, pid: int, arguments: Sequence[int]) -> Iterator[Contact]:
    """Yield the contacts of one call."""
    words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
    program = b" ".join(words).decode(errors="replace")[:PROGRAM_MAX].partition("\n")[0].strip()
    with Path(f"/proc/{pid}/mem").open("rb", 0) as memory:
        for address, size in _targets(name, arguments, memory):
            target = _parsed(_read(memory, address, min(size, 128))) if address else None
            if target:
                yield Contact(name if name in ("connect", "bind") else "send", *target, program)


def _targets(name: str, arguments: Sequence[int], memory: BinaryIO) -> Iterator[tuple[int, int]]:
    """Yield locations of the addresses of a call in the process, and their sizes."""
    if name in ("connect", "bind"):
        yield arguments[1], arguments[2]
    elif name == "sendto":
        yield arguments[4], arguments[5]
    else:
        count = min(arguments[2], MESSAGES_MAX) if name == "sendmmsg" else 1
        for index in range(count):
            yield struct.unpack("QI", _read(memory, arguments[1] + index * 64, 12))


def _read(memory: BinaryIO, address: int, size: int) -> bytes:
    memory.seek(address)
    return memory.read(size)


def _parsed(raw: bytes) -> tuple[str, int] | None:
    """Return address and port of a socket's address; None for a local socket."""
    family = int.from_bytes(raw[:2], sys.byteorder)
    if family == socket.AF_INET:
        return socket.inet_ntop(family, raw[4:8]), int.from_bytes(raw[2:4], "big")
    if family == socket.AF_INET6:
        return socket.inet_ntop(family, raw[8:24]), int.from_bytes(raw[2:4], "big")
    if family == socket.AF_UNIX and raw[2:].startswith(RESOLVER):
        return raw[2:].split(b"\0")[0].decode(errors="replace"), 0
    return None


def main(command: Sequence[str]) -> int:
    """Watch a command; print its contacts and files, and return the exit code."""
    if not command or missing():
        print(missing() or __doc__)
        return 2
    with tempfile.TemporaryDirectory(prefix="p4d") as folder:
        code, contacts = watch(command, homeless(Path(folder)))
        outward = sorted(contact for contact in contacts if contact.outward)
        files = left_files(Path(folder))
    print(
        f"{len(contacts) - len(outward)} addresses of this machine, {len(outward)} of others",
        *outward,
        sep="\n  ",
    )
    print(f"{len(files)} files left in the home folder", *files, sep="\n  ")
    return code or bool(outward or files)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
