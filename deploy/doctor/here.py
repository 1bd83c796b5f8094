"""Checks of this host: processes, router, settings and models."""

import re
import socket
from collections.abc import Iterator, Mapping
from pathlib import Path

from common.diagnosis.evidence import Diagnostic, ok, problem, warning
from deploy import compose
from deploy.launcher.launcher import FAILURE, tail
from deploy.launcher.plan import COMPOSE_FILE, config_file, load_model, read_settings
from deploy.launcher.state import State, running_robots
from deploy.launcher.supervisor import Supervisor, SupervisorGoneError
from people4d.errors import ConfigError, People4dError

CONNECT_S = 1.0
TAIL_LINES = 200
ENDPOINT = re.compile(r"(?P<scheme>tcp|tls)/(?P<host>.+):(?P<port>\d+)")


def router(endpoint: str, error: People4dError) -> Diagnostic:
    """Return the diagnostic of a failed session with a router."""
    match = ENDPOINT.fullmatch(endpoint.partition(",")[0])
    if not match:
        hint = "Write it as tcp/192.168.1.7:7447."
        return problem("router", f"{endpoint!r} is not an endpoint", hint)
    if isinstance(error, ConfigError):
        return problem("settings", error.problem, error.hint)
    if not _listens(match["host"], int(match["port"])):
        hint = "Start the system (people4d up), or name its router: --connect tcp/HOST:7447."
        return problem("router", f"no router listens at {endpoint}", hint)
    hint = (
        "Does PEOPLE4D_KEYS name the folder of keys for this host and role (people4d keys), do "
        "router and this command both use tcp or both tls, and is it a people4d router?"
    )
    return problem("router", f"{endpoint} refuses this machine: {error.problem}", hint)


def _listens(host: str, port: int) -> bool:
    try:
        with socket.create_connection((host.strip("[]"), port), CONNECT_S):
            return True
    except OSError:
        return False


def running(state: State) -> Iterator[Diagnostic]:
    """Check the processes of people4d up on this host, or report its last failure."""
    if not state.read():
        if failure := tail(state.folder / FAILURE, TAIL_LINES):
            hint = "Correct it and start people4d up again; people4d logs has the rest."
            yield problem("processes", f"the last people4d up failed: {failure}", hint)
        if others := running_robots():
            hint = f"Add --robot {others[0]}, or start it: people4d up --robot {state.folder.name}."
            what = f"nothing runs here for {state.folder.name}; {', '.join(others)} does"
            yield warning("processes", what, hint)
        return
    try:
        processes = Supervisor(state).processes()
    except SupervisorGoneError as error:
        yield problem("processes", error.problem, error.hint)
        return
    running = True
    for process in processes.values():
        name, log = process.name, state.log_of(process.name)
        if process.finished:
            what = f"{name} ended: {_last_word(log)}"
            yield warning(
                "processes",
                what,
                "A recording is played once: people4d up --loop repeats it.",
                name,
            )
        elif process.state not in ("RUNNING", "STARTING", "STOPPED", "STOPPING"):
            what = f"{name} does not stay up: {_last_word(log)}"
            yield problem("processes", what, f"The whole log: {log}", name)
        else:
            continue
        running = False
    if running:
        yield ok("processes", f"{len(processes)} processes run here")


def _last_word(log: Path) -> str:
    """Return the last error of a log, else its last line."""
    lines = [line for line in tail(log, TAIL_LINES).splitlines() if line.strip()]
    errors = [line.partition(" ERROR ")[2] for line in lines if " ERROR " in line]
    if errors:
        return errors[-1]
    return lines[-1].partition(" INFO ")[2] or lines[-1] if lines else "its log is empty"


def settings(config: Path | None, environment: Mapping[str, str]) -> Iterator[Diagnostic]:
    """Check that the settings of every service can be read and its model loaded."""
    file = config or config_file(environment)
    good = True
    for service in compose.read(COMPOSE_FILE, environment):
        try:
            record = read_settings(service, file, environment)
        except People4dError as error:
            good = False
            hint = error.hint or f"Set it right in {file} or in the environment."
            yield problem("settings", error.problem, hint)
            continue
        if record and "people4d.model" in service.labels:
            try:
                yield ok("model", f"{service.name}: {load_model(service, record)} can be loaded")
            except People4dError as error:
                hint = error.hint or "See people4d models."
                yield problem("model", f"{service.name}: {error.problem}", hint)
    if good:
        yield ok("settings", f"{file} can be used")
