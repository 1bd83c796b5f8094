"""State folder of a running system: socket, logs, plan and endpoint."""

import fcntl
import os
import shutil
import signal
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated

import msgspec
import psutil
from msgspec import Meta

from common.io.files import replace_file
from common.runtime.checkpoint import SUFFIX as CHECKPOINT
from common.runtime.checkpoint import state_folder
from common.transport.trace import JOINED
from people4d.errors import ConfigError, People4dError
from people4d.messages.base import check_name
from services.dashboard.address import ADDRESS_FILE

# A socket's path has 108 bytes; supervisord binds "<path>.<pid>" first, and a 0 ends it.
LONGEST_SOCKET_PATH = 108 - 1 - len(".4194304")
MARK = "PEOPLE4D_RUN"
LOCK = "start.lock"  # file that a start or stop locks
POLL_S = 0.05
GRACE_S = 3.0  # time between SIGTERM and SIGKILL [s]


class Run(msgspec.Struct, frozen=True, kw_only=True):
    """Record of a running system."""

    connect: str  # endpoint of its router, for example tcp/127.0.0.1:7447
    pid: Annotated[int, Meta(ge=1)]  # process number of supervisord


class State:
    """Folder of one robot's system on this machine; `prepare` creates it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.socket = folder / "supervisor.sock"
        self.config = folder / "supervisord.conf"
        self.log = folder / "supervisord.log"
        self.run_file = folder / "run.json"
        self.plan_file = folder / "plan.json"  # see deploy.launcher.launcher.read_plan

    @classmethod
    def of_robot(cls, robot: str, environment: Mapping[str, str] = os.environ) -> "State":
        """Return the state of a robot: $PEOPLE4D_STATE/<robot>, else under $XDG_STATE_HOME.

        ConfigError if the robot's name cannot be part of a key.
        """
        try:
            check_name("robot", robot)
        except ValueError as error:
            raise ConfigError(str(error)) from error
        return cls(state_folder(robot, environment))

    def log_of(self, instance: str) -> Path:
        """Return the log file of an instance, which may share its process."""
        shared = (f for f in self.folder.glob(f"*{JOINED}*.log") if instance in names_of(f))
        return next(shared, self.folder / f"{instance}.log")

    def prepare(self) -> None:
        """Create the folder, for its owner only.

        ConfigError if the path is too long for a socket, or the folder cannot be made.
        """
        length = len(os.fsencode(self.socket))
        if length > LONGEST_SOCKET_PATH:
            raise ConfigError(
                f"socket path {self.socket} has {length} bytes, at most {LONGEST_SOCKET_PATH} work",
                "Set PEOPLE4D_STATE to a folder with a shorter path.",
            )
        try:
            self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            status = self.folder.stat()
            if status.st_uid != os.geteuid():
                raise ConfigError(
                    f"state folder {self.folder} belongs to user {status.st_uid}",
                    "Set PEOPLE4D_STATE to a folder of your own.",
                )
            self.folder.chmod(0o700)
        except OSError as error:
            raise ConfigError(
                f"state folder {self.folder} cannot be made: {error.strerror}",
                "Set PEOPLE4D_STATE to a folder that you may write to.",
            ) from error

    def tidy(self) -> None:
        """Remove files of the previous run; People4dError if a file cannot be removed."""
        stale = ("*.log*", f"*{CHECKPOINT}", ADDRESS_FILE)
        try:
            for old in [file for pattern in stale for file in self.folder.glob(pattern)]:
                old.unlink(missing_ok=True)
        except OSError as error:
            raise People4dError(
                f"{error.filename} cannot be removed: {error.strerror}", "Remove it by hand."
            ) from error

    @contextmanager
    def locked(self, timeout_s: float) -> Iterator[bool]:
        """Exclude other starts and stops; yield False if one of them outlasts the timeout."""
        try:
            lock = (self.folder / LOCK).open("w")
        except OSError:  # without a folder nothing runs
            yield True
            return
        with lock:
            deadline_s = time.monotonic() + timeout_s
            while not (own := _lock(lock.fileno())) and time.monotonic() < deadline_s:
                time.sleep(POLL_S)
            yield own

    def write(self, file: Path, content: bytes) -> None:
        """Create the folder, its owner's only; ConfigError if that, or a socket, is impossible."""
        try:
            replace_file(file, content, 0o600)
        except OSError as error:
            raise People4dError(
                f"{file} cannot be written: {error.strerror}",
                "Make room, or set PEOPLE4D_STATE to a folder on another disk.",
            ) from error

    def read(self) -> Run | None:
        """Return the record of the running system, None if no system runs."""
        try:
            run = msgspec.json.decode(self.run_file.read_bytes(), type=Run)
        except (OSError, msgspec.DecodeError, UnicodeDecodeError):
            return None
        return run if _is_marked(run.pid, self.folder) else None

    def was_stopped(self, timeout_s: float) -> bool:
        """Wait for the end of a stop; return False if supervisord was killed."""
        deadline_s = time.monotonic() + timeout_s
        while self.run_file.exists():
            if self.read():
                deadline_s = time.monotonic() + timeout_s
            elif time.monotonic() > deadline_s:
                return False
            time.sleep(POLL_S)
        return True

    def clear(self) -> None:
        """Remove the record of the run, but not its logs."""
        self.run_file.unlink(missing_ok=True)
        self.socket.unlink(missing_ok=True)

    def remove(self) -> None:
        """Remove the folder with its logs."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def leftovers(self) -> list[psutil.Process]:
        """Return living processes of this system; zombies have no mark."""
        return [p for p in psutil.process_iter() if _is_marked(p.pid, self.folder)]

    def kill_processes(self, exclude: Collection[int]) -> None:
        """Kill all processes except some process groups."""
        for process in self.leftovers():
            with suppress(psutil.Error, ProcessLookupError):
                if os.getpgid(process.pid) not in exclude:
                    process.kill()

    def sweep(self) -> int:
        """End processes of a killed supervisord, and return their number."""
        leftovers = alive = self.leftovers()
        for number in (signal.SIGTERM, signal.SIGKILL):
            for process in alive:
                with suppress(psutil.NoSuchProcess):
                    process.send_signal(number)
            deadline_s = time.monotonic() + GRACE_S
            while (alive := self.leftovers()) and time.monotonic() < deadline_s:
                time.sleep(POLL_S)
        if alive:
            raise People4dError(
                f"processes {[process.pid for process in alive]} do not end", "End them by hand."
            )
        return len(leftovers)


def running_robots(environment: Mapping[str, str] = os.environ) -> list[str]:
    """Return the names of the robots with a running system on this host."""
    folders = State.of_robot("robot", environment).folder.parent.glob("*")
    return sorted(folder.name for folder in folders if State(folder).read())


def names_of(log: Path) -> list[str]:
    """Return the instances of a log file."""
    return log.stem.split(JOINED)


def _lock(descriptor: int) -> bool:
    """Lock a file; return False if another process holds the lock."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _is_marked(pid: int, folder: Path) -> bool:
    """Check that a process belongs to the system of a state folder."""
    try:
        return psutil.Process(pid).environ().get(MARK) == str(folder)
    except (psutil.Error, OSError):
        return False
