"""Supervisord: its configuration, its start and its remote calls."""

import contextlib
import os
import re
import resource
import shutil
import subprocess
import sys
import time
import xmlrpc.client
from collections.abc import Sequence
from dataclasses import dataclass
from http.client import HTTPException
from typing import Any

from supervisor.xmlrpc import Faults, SupervisorTransport

from common.runtime.checkpoint import FOLDER as STATE
from common.transport.trace import JOINED
from deploy.compose import Service
from deploy.launcher.joined import INSTANCE, joined_service
from deploy.launcher.state import MARK, State
from people4d.errors import ConfigError, People4dError

SAFE = re.compile(r"[^\w@+=:,./-]", re.ASCII)
FILES_MIN = 1024  # minimum number of open files of supervisord
TRACE_S = 0.1  # time for a hung process to write its stack [s]

PREFORK = {
    "OMP_NUM_THREADS": "1",  # forks cannot share libraries with threads
    "SPT_NOENV": "1",  # process titles must not overwrite the environment, which marks processes
}

HEAD = """\
[unix_http_server]
file={socket}
chmod=0700

[supervisord]
logfile={log}
logfile_maxbytes=1MB
logfile_backups=1
pidfile={folder}/supervisord.pid
childlogdir={folder}

[rpcinterface:supervisor]
supervisor.rpcinterface_factory=supervisor.rpcinterface:make_main_rpcinterface
"""

PROGRAM = """
[program:{instance}]
command={command}
priority={priority}
autostart=false
autorestart={autorestart}
startsecs={startsecs}
startretries={retries}
exitcodes=0
stopsignal=TERM
stopwaitsecs={stop_grace_s}
stopasgroup=true
killasgroup=true
redirect_stderr=true
stdout_logfile={log}
stdout_logfile_maxbytes=10MB
stdout_logfile_backups=1
"""

AUTORESTART = {"no": "false", "on-failure": "unexpected"}  # restart policies; others are "true"


@dataclass(frozen=True)
class Process:
    """State of one process in supervisord."""

    name: str  # instance, for example detector-1
    state: str  # STOPPED, STARTING, RUNNING, BACKOFF, STOPPING, EXITED, FATAL or UNKNOWN
    pid: int  # process number, 0 if it does not run
    uptime_s: float  # [s] time since the start; 0 if the process does not run
    exit_status: int  # last exit status; -1 after a signal
    problem: str  # error at the start; empty if it succeeded

    @property
    def finished(self) -> bool:
        """True if the process exited with status 0."""
        return self.state == "EXITED" and self.exit_status == 0

    @property
    def ended_badly(self) -> bool:
        """True if the process exited with an error; supervisord may restart it."""
        return self.state == "EXITED" and self.exit_status != 0

    @property
    def gave_up(self) -> bool:
        """True if supervisord will not restart the failed process."""
        return self.state in ("FATAL", "UNKNOWN")


def render(state: State, services: Sequence[Service]) -> str:
    """Return supervisord's configuration: services start in order, and stop in reverse."""
    folder = _text(str(state.folder))
    parts = [HEAD.format(socket=_text(str(state.socket)), log=_text(str(state.log)), folder=folder)]
    for priority, service in enumerate(services, start=1):
        for name in service.instances:
            if not service.partners or name != service.instances[0]:
                parts.append(_program(state, service, name, priority))
            elif service.name == service.partners[-1]:
                program, names = joined_service(service, services)
                parts.append(_program(state, program, names, priority))
    return "".join(parts)


def _program(state: State, service: Service, instance: str, priority: int) -> str:
    variables = {
        **service.environment,
        MARK: str(state.folder),
        STATE: str(state.folder.parent),
        INSTANCE: instance,
    }
    # Variables are set by env(1), since supervisord's syntax cannot express every value.
    env = [shutil.which("env") or "/usr/bin/env", *(f"{k}={v}" for k, v in variables.items())]
    return PROGRAM.format(
        instance=instance,
        command=" ".join(map(quote, [*env, *local_command(service.command)])),
        priority=priority,
        autorestart=AUTORESTART.get(service.restart, "true"),
        # A process without restarts may finish immediately.
        startsecs=0 if service.restart == "no" else 1,
        retries=service.retries,
        stop_grace_s=max(1, round(service.stop_grace_s)),
        log=_text(str(state.log_of(instance))),
    )


def local_command(command: Sequence[str]) -> list[str]:
    """Translate a container command to the programs of this environment."""
    program, *arguments = command
    if program in ("python", "python3"):
        return [sys.executable, *arguments]
    if program == "people4d":
        return [sys.executable, "-m", "deploy.cli", *arguments]
    return [program, *arguments]


def quote(argument: str) -> str:
    r"""Quote one argument of a command for supervisord's configuration.

    The file is cut at " #" and " ;" and expands "%"; a backslash before every special character
    leaves no blank before a comment sign. ConfigError if the argument has more than one line.
    """
    if "\n" in argument or "\r" in argument:
        raise ConfigError(f"argument {argument!r:.60} has more than one line")
    quoted = SAFE.sub(lambda match: "\\" + match[0], argument).replace("%", "%%")
    # A pair of quotes protects a blank at the end of the line.
    return quoted + "''" if not quoted or argument[-1].isspace() else quoted


def _text(path: str) -> str:
    if re.search(r"\s[#;]|[\n\r]", path):
        raise ConfigError(f"path {path!r} cannot be written into a configuration file")
    return path.replace("%", "%%")


def _start_failure(done: subprocess.CompletedProcess[str]) -> People4dError:
    """Return the error of a failed start of supervisord."""
    _, files = resource.getrlimit(resource.RLIMIT_NOFILE)
    if done.returncode > 0 and files < FILES_MIN:
        return People4dError(
            f"supervisord does not start: at most {files} files may be open here",
            f"Allow {FILES_MIN}: ulimit -n {FILES_MIN}.",
        )
    lines = (done.stdout + done.stderr).strip().splitlines()
    errors = [line.removeprefix("Error: ") for line in lines if line.startswith("Error: ")]
    signalled = f"signal {-done.returncode} ended it"
    reason = (errors or lines or [signalled if done.returncode < 0 else "it gives no reason"])[-1]
    return People4dError(f"supervisord does not start: {reason}")


class SupervisorGoneError(People4dError):
    """Supervisord does not answer, or is stopping."""


class Supervisor:
    """The supervisord of one system."""

    def __init__(self, state: State) -> None:
        self.state = state

    def spawn(self, services: Sequence[Service]) -> int:
        """Start supervisord without services, and return its process number; or People4dError."""
        self.state.write(self.state.config, render(self.state, services).encode())
        # Supervisord detaches from this process and its terminal once its socket is open.
        done = subprocess.run(
            # -P: modules of the working directory must not replace ours.
            [sys.executable, "-P", "-m", "deploy.launcher.prefork", "-c", str(self.state.config)],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            env={**PREFORK, **os.environ, MARK: str(self.state.folder)},
            check=False,
        )
        if done.returncode:
            raise _start_failure(done)
        return int(self._call("supervisor.getPID"))

    def start(self, instance: str) -> None:
        """Start one process without waiting; no effect on a running one."""
        with contextlib.suppress(xmlrpc.client.Fault):  # the state of the process shows the failure
            self._call("supervisor.startProcess", self._name_of(instance), False)

    def kill(self, instance: str, trace: bool = True) -> None:
        """Kill a process; with `trace` it first writes its stack to its log.

        The request for the stack would end a process without a handler.
        """
        program = self._name_of(instance)
        with contextlib.suppress(xmlrpc.client.Fault):  # not running
            if trace:
                self._call("supervisor.signalProcess", program, "USR2")
                time.sleep(TRACE_S)
            self._call("supervisor.signalProcess", program, "KILL")

    def rescale(self, services: Sequence[Service]) -> tuple[list[str], list[str]]:
        """Change the numbers of processes: stop surplus processes, add others without a start.

        Returns:
            Names of the new and of the stopped processes.
        """
        self.state.write(self.state.config, render(self.state, services).encode())
        ((added, _, removed),) = self._call("supervisor.reloadConfig")
        added, removed = (sorted(names, key=lambda n: (len(n), n)) for names in (added, removed))
        for instance in removed:
            with contextlib.suppress(xmlrpc.client.Fault):  # not running
                self._call("supervisor.stopProcess", instance, True)
            self._call("supervisor.removeProcessGroup", instance)
        for instance in added:
            self._call("supervisor.addProcessGroup", instance)
        return added, removed

    def processes(self) -> dict[str, Process]:
        """Return all processes by instance name; a shared process has several names.

        SupervisorGoneError if supervisord does not answer.
        """
        return {
            name: Process(
                name=name,
                state=info["statename"],
                pid=info["pid"],
                uptime_s=float(info["now"] - info["start"]) if info["pid"] else 0.0,
                exit_status=info["exitstatus"],
                problem=info["spawnerr"],
            )
            for info in self._call("supervisor.getAllProcessInfo")
            for name in info["name"].split(JOINED)
        }

    def _name_of(self, instance: str) -> str:
        """Return the name of the process of an instance in supervisord."""
        every = (info["name"] for info in self._call("supervisor.getAllProcessInfo"))
        return next((name for name in every if instance in name.split(JOINED)), instance)

    def shutdown(self) -> None:
        """Make supervisord stop all processes, the last started first, and exit."""
        self._call("supervisor.shutdown")

    def _call(self, method: str, *arguments: str | bool) -> Any:
        # A transport does not recover from a failed call, so each call has its own.
        transport = SupervisorTransport(None, None, serverurl=f"unix://{self.state.socket}")
        server = xmlrpc.client.ServerProxy("http://localhost", transport=transport)
        try:
            with contextlib.closing(transport):
                return getattr(server, method)(*arguments)
        except xmlrpc.client.Fault as fault:
            if fault.faultCode == Faults.SHUTDOWN_STATE:
                raise SupervisorGoneError(f"supervisord of {self.state.folder} stops") from fault
            raise
        except (OSError, HTTPException, xmlrpc.client.ProtocolError) as error:
            raise SupervisorGoneError(
                f"supervisord of {self.state.folder} does not answer ({error})",
                "Run people4d down, then people4d up.",
            ) from error
