"""Another number of processes for a service of a running system."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import msgspec

from deploy.compose import Service
from deploy.launcher.health import Heartbeats, check_of
from deploy.launcher.launcher import TAIL_LINES, LaunchError, tail
from deploy.launcher.plan import replicas_of
from deploy.launcher.state import State
from deploy.launcher.supervisor import Supervisor
from people4d.errors import People4dError

POLL_S = 0.1

Progress = Callable[[str, str], None]


def scale(
    state: State,
    requests: Sequence[str],
    heartbeats: Heartbeats,
    timeout_s: float,
    progress: Progress,
) -> None:
    """Start or stop processes of a running system, and wait until the new ones work.

    Args:
        state: Its folder.
        requests: "service=number".
        heartbeats: Where its services tell how they are.
        timeout_s: Longest time until a new process works.
        progress: Told of each change: name of the service or process, what happened.

    Raises:
        ConfigError: A request names no service, or one that runs only once.
        LaunchError: A new process does not come up; it is left as it is.
    """
    services = read_plan(state)
    numbers = replicas_of(requests, services)
    services = tuple(replace(s, replicas=numbers[s.name]) for s in services)
    supervisor = Supervisor(state)
    added, removed = supervisor.rescale(services)
    state.plan_file.write_bytes(msgspec.json.encode(services))
    for instance in removed:
        progress(instance, "stopped")
    for instance in added:
        supervisor.start(instance)
    for service in services:
        new = [name for name in service.instances if name in added]
        if new:
            _wait(supervisor, service, new, heartbeats, time.monotonic() + timeout_s)
            progress(", ".join(new), "ready")


def read_plan(state: State) -> tuple[Service, ...]:
    """Return the services that a system was started with.

    Raises:
        People4dError: The plan of the run is missing or damaged.
    """
    try:
        return msgspec.json.decode(state.plan_file.read_bytes(), type=tuple[Service, ...])
    except (OSError, msgspec.DecodeError) as error:
        raise People4dError(
            f"{state.plan_file} does not tell what runs ({error})",
            "Run people4d down, then people4d up.",
        ) from error


def _wait(
    supervisor: Supervisor,
    service: Service,
    instances: Sequence[str],
    heartbeats: Heartbeats,
    deadline_s: float,
) -> None:
    check, state = check_of(service, heartbeats), supervisor.state
    try:
        while True:
            all_processes = supervisor.processes()
            processes = [all_processes[name] for name in instances]
            if check.healthy(processes):
                return
            failed = [p for p in processes if p.gave_up or p.state == "BACKOFF" or p.ended_badly]
            late = processes if time.monotonic() > deadline_s else []
            for process in [*failed, *late]:
                log = state.log_of(process.name)
                problem = f"{process.name} does not get ready, it is {process.state}"
                raise LaunchError(problem, f"The whole log: {log}", tail(log, TAIL_LINES))
            time.sleep(POLL_S)
    finally:
        check.close()
