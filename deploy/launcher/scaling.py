"""Changes of the number of replicas of a running system."""

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import msgspec
import psutil

from deploy.compose import Service
from deploy.launcher.health import Heartbeats
from deploy.launcher.launcher import POLL_S, LaunchError, Progress, read_plan
from deploy.launcher.plan import replicas_of
from deploy.launcher.state import State
from deploy.launcher.supervisor import Process, Supervisor
from people4d.errors import ConfigError

RESERVE = 0.9  # maximum share of the free memory for new processes

Plan = tuple[Service, ...]


def scale(
    state: State,
    requests: Sequence[str],
    heartbeats: Heartbeats,
    timeout_s: float,
    progress: Progress,
    force: bool = False,
) -> None:
    """Start or stop processes of a running system, one at a time.

    If a process is not ready after `timeout_s`, all new ones are stopped. ConfigError if a request,
    "service=number", names no service, a single-process service, or more replicas than this machine
    can run; LaunchError if a new process does not get ready.

    Args:
        state: State of the system.
        requests: Numbers of replicas, "service=number".
        heartbeats: Heartbeats of the system.
        timeout_s: Maximum wait for each new process [s].
        progress: Reports events.
        force: Start more replicas than this host has cores or free memory for.
    """
    before = read_plan(state)
    numbers = replicas_of(requests, before)
    after = tuple(replace(s, replicas=numbers[s.name]) for s in before)
    supervisor = Supervisor(state)
    if not force:
        check_capacity(before, after, supervisor.processes())
    reduced = tuple(replace(s, replicas=min(s.replicas, numbers[s.name])) for s in before)
    for instance in _apply(state, supervisor, reduced)[1]:
        progress(instance, "stopped")
    try:
        for plan in _one_more(reduced, after):
            for instance in _apply(state, supervisor, plan)[0]:
                supervisor.start(instance)
                _wait(state, supervisor, heartbeats, plan, instance, timeout_s)
                progress(instance, "ready")
    except BaseException:
        for instance in _apply(state, supervisor, reduced)[1]:
            progress(instance, "stopped again")
        raise


def check_capacity(
    before: Plan,
    after: Plan,
    processes: dict[str, Process],
    cores: int | None = None,
    free_mb: float | None = None,
) -> None:
    """Check that a host can run added replicas.

    ConfigError if a service would have more replicas than cores, or memory is insufficient.

    Args:
        before: Services with their current number of replicas.
        after: Services with the requested number of replicas.
        processes: Running processes by name; a new replica needs the memory of a running one.
        cores: Processor cores; None: cores of this host.
        free_mb: Free memory in MiB; None: free memory of this host.
    """
    cores = cores or len(os.sched_getaffinity(0))
    free_mb = psutil.virtual_memory().available / 2**20 if free_mb is None else free_mb
    hint = "Ask for fewer, or add --force."
    needed_mb = 0.0
    for old, new in zip(before, after, strict=True):
        if new.replicas > max(cores, old.replicas):
            problem = f"{new.name}={new.replicas}: this machine has {cores} cores"
            raise ConfigError(f"{problem}, more replicas are slower", hint)
        if new.replicas > old.replicas:
            sizes_mb = [_size_mb(processes[name].pid) for name in old.instances]
            needed_mb += (new.replicas - old.replicas) * max(sizes_mb, default=0.0)
    if needed_mb > RESERVE * free_mb:
        problem = f"new processes would take about {needed_mb:.0f} MB"
        raise ConfigError(f"{problem} of {free_mb:.0f} MB that are free", hint)


def _size_mb(pid: int) -> float:
    with suppress(psutil.Error):
        return float(psutil.Process(pid).memory_info().rss / 2**20) if pid else 0.0
    return 0.0


def _one_more(plan: Plan, last: Plan) -> Iterator[Plan]:
    """Yield plans with one replica more each, up to the last one."""
    for index, service in enumerate(last):
        while plan[index].replicas < service.replicas:
            grown = replace(plan[index], replicas=plan[index].replicas + 1)
            plan = (*plan[:index], grown, *plan[index + 1 :])
            yield plan


def _apply(state: State, supervisor: Supervisor, plan: Plan) -> tuple[list[str], list[str]]:
    """Apply a plan to the system; return the added and the stopped processes."""
    changed = supervisor.rescale(plan)
    state.write(state.plan_file, msgspec.json.encode(plan))
    return changed


def _wait(
    state: State,
    supervisor: Supervisor,
    heartbeats: Heartbeats,
    plan: Plan,
    instance: str,
    timeout_s: float,
) -> None:
    (service,) = (s for s in plan if instance in s.instances)
    deadline_s = time.monotonic() + timeout_s
    while not heartbeats.healthy(service, [process := supervisor.processes()[instance]]):
        failed = process.gave_up or process.ended_badly or process.state == "BACKOFF"
        if failed or time.monotonic() > deadline_s:
            problem = f"{instance} does not get ready, it is {process.state}"
            raise LaunchError(state, instance, problem)
        time.sleep(POLL_S)
