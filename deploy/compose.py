"""Services of a compose file, for local processes.

The file is valid for docker compose. Fields of containers are ignored here; an unknown field is an
error.
"""

import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from deploy import compose_file
from deploy.compose_file import interpolate
from people4d.errors import ConfigError

REPLICAS_MAX = 999
CONDITIONS = ("service_started", "service_healthy", "service_completed_successfully")
RESTARTS = ("no", "always", "unless-stopped", "on-failure")
# fmt: off
CONTAINER_ONLY = frozenset((
    "annotations", "build", "cap_add", "cap_drop", "container_name", "cpus", "device_cgroup_rules",
    "devices", "dns", "expose", "extra_hosts", "group_add", "hostname", "image", "init", "ipc",
    "logging", "mem_limit", "memswap_limit", "network_mode", "networks",
    "oom_score_adj", "pids_limit", "platform", "ports", "privileged", "pull_policy", "read_only",
    "security_opt", "shm_size", "sysctls", "tmpfs", "tty", "ulimits", "user", "volumes",
    "working_dir",
))
USED = frozenset((
    "command", "depends_on", "deploy", "environment", "healthcheck", "labels", "profiles",
    "restart", "stop_grace_period",
))
# fmt: on
CONTAINER_ONLY_TOP = frozenset({"name", "networks", "version", "volumes"})
USED_DEPLOY = frozenset({"replicas"})
CONTAINER_ONLY_DEPLOY = frozenset({"labels", "mode", "resources"})

BUILT_IN_CHECK = ["CMD", "people4d", "health"]
USED_HEALTHCHECK = frozenset({"test"})
TIMING = frozenset({"interval", "timeout", "start_period", "start_interval", "retries"})

Table = Mapping[str, Any]


@dataclass(frozen=True)
class Dependency:
    """Condition of another service for the start of a service."""

    service: str  # name of the other service
    condition: str  # one of CONDITIONS
    required: bool  # False: ignored if the other service is not part of the run


@dataclass(frozen=True)
class Service:
    """One service of the system."""

    name: str  # name of the service
    command: tuple[str, ...]  # command, one string per argument
    environment: Mapping[str, str]  # environment variables, added to the caller's environment
    depends_on: tuple[Dependency, ...]  # services that have to start earlier
    has_healthcheck: bool  # health by its heartbeat; False: it is healthy while it runs
    restart: str  # one of RESTARTS
    retries: int  # maximum number of failed starts in a row
    replicas: Annotated[int, Meta(ge=0, le=REPLICAS_MAX)]  # number of equal processes
    stop_grace_s: float  # time between SIGTERM and SIGKILL
    profiles: frozenset[str]  # profiles with this service; empty: all
    # facts of deploy/compose.yaml, for example `people4d.scalable`
    labels: Mapping[str, str] = field(default_factory=dict)
    # services that share its first process, including itself; empty: it has its own process
    partners: tuple[str, ...] = ()

    @property
    def module(self) -> str:
        """Python module of the service; empty if it is another program."""
        program, *arguments = self.command
        is_module = program.startswith("python") and "-m" in arguments
        return arguments[arguments.index("-m") + 1] if is_module else ""

    def has(self, fact: str) -> bool:
        """Check a fact of the service: needed, scalable or joinable."""
        return self.labels.get(f"people4d.{fact}") == "true"

    @property
    def option(self) -> str:
        """Command-line option of the service; empty if it always runs."""
        named = self.labels.get("people4d.option", "")
        return named or (f"--profile {min(self.profiles)}" if self.profiles else "")

    @property
    def instances(self) -> tuple[str, ...]:
        """Names of the processes: detector-1, detector-2."""
        return tuple(f"{self.name}-{n}" for n in range(1, self.replicas + 1))


def read(file: Path, variables: Mapping[str, str]) -> tuple[Service, ...]:
    """Read the services of a compose file, of all profiles, and expand variables.

    ConfigError if the file cannot be read, or has a field without meaning for local processes.
    """
    try:
        top = _fields(compose_file.load(file), frozenset({"services"}), CONTAINER_ONLY_TOP, "")
        tables = _table(top.get("services", {}), "services")
        return tuple(
            _service(name, interpolate(table, variables)) for name, table in tables.items()
        )
    except ValueError as error:
        raise ConfigError(f"compose file {file}: {error}") from error


def select(services: Sequence[Service], profiles: Set[str]) -> tuple[Service, ...]:
    """Return the services of a run in start order.

    ConfigError if a dependency is unknown, or services wait for each other.
    """
    running = {s.name: s for s in services if not s.profiles or s.profiles & profiles}
    for name, service in running.items():
        present = [d for d in service.depends_on if d.required or d.service in running]
        running[name] = replace(service, depends_on=tuple(present))
        for other in present:
            if other.service not in running:
                problem = f"{name} depends on {other.service}, which does not run"
                raise ConfigError(f"compose file: {problem}")
    graph = {s.name: [d.service for d in s.depends_on] for s in running.values()}
    try:
        return tuple(running[name] for name in TopologicalSorter(graph).static_order())
    except CycleError as error:
        cycle = " -> ".join(error.args[1])
        raise ConfigError(f"compose file: services wait for each other: {cycle}") from error


def _service(name: str, value: Any) -> Service:
    fields = _fields(value, USED, CONTAINER_ONLY, name)
    command = fields.get("command")
    if not command or not isinstance(command, list):
        raise ValueError(f"{name}.command: expected a list of arguments, got {command!r}")
    restart, _, retries = str(fields.get("restart") or "no").partition(":")
    if restart not in RESTARTS or (retries and not retries.isdecimal()):
        raise ValueError(f"{name}.restart: expected one of {', '.join(RESTARTS)}, got {restart!r}")
    deploy = _fields(fields.get("deploy", {}), USED_DEPLOY, CONTAINER_ONLY_DEPLOY, f"{name}.deploy")
    replicas = str(deploy.get("replicas", 1))
    if not re.fullmatch(r"0*\d{1,3}", replicas, re.ASCII):
        raise ValueError(
            f"{name}.deploy.replicas: expected a number of 0 to {REPLICAS_MAX}, got {replicas!r}"
        )
    return Service(
        name=name,
        command=tuple(map(str, command)),
        environment=_environment(fields.get("environment", {}), f"{name}.environment"),
        depends_on=_dependencies(fields.get("depends_on", {}), f"{name}.depends_on"),
        has_healthcheck=_has_healthcheck(fields.get("healthcheck"), f"{name}.healthcheck"),
        restart=restart,
        retries=0 if restart == "no" else int(retries or 5),
        replicas=int(replicas),
        stop_grace_s=_seconds(fields.get("stop_grace_period", "10s"), f"{name}.stop_grace_period"),
        profiles=frozenset(fields.get("profiles", ())),
        labels=_environment(fields.get("labels", {}), f"{name}.labels"),
    )


def _dependencies(value: Any, path: str) -> tuple[Dependency, ...]:
    if isinstance(value, list):
        return tuple(Dependency(str(name), CONDITIONS[0], True) for name in value)
    found = []
    for name, entry in _table(value, path).items():
        fields = _fields(
            entry or {}, frozenset({"condition", "required"}), frozenset({"restart"}), path
        )
        condition = fields.get("condition", CONDITIONS[0])
        if condition not in CONDITIONS:
            raise ValueError(f"{path}.{name}: expected one of {', '.join(CONDITIONS)}")
        found.append(Dependency(name, condition, bool(fields.get("required", True))))
    return tuple(found)


def _has_healthcheck(value: Any, path: str) -> bool:
    test = [] if value is None else _fields(value, USED_HEALTHCHECK, TIMING, path).get("test")
    if test and test[:3] != BUILT_IN_CHECK:
        raise ValueError(f"{path}.test: expected [CMD, people4d, health, ...], got {test}")
    return bool(test)


def _environment(value: Any, path: str) -> dict[str, str]:
    # A name without a value is inherited from the caller, as all variables of a local process.
    return {
        key: str(item).lower() if isinstance(item, bool) else str(item)
        for key, item in _table(value, path).items()
        if item is not None
    }


def _seconds(value: Any, path: str) -> float:
    match = re.fullmatch(r"(\d+(?:\.\d+)?)s", str(value))
    if not match:
        raise ValueError(f"{path}: expected a duration in seconds such as 10s, got {value!r}")
    return float(match[1])


def _fields(value: Any, used: Set[str], passed_over: Set[str], path: str) -> Table:
    table = _table(value, path or "file")
    for name in table:
        if name not in used and name not in passed_over and not name.startswith("x-"):
            where = f"{path}.{name}" if path else name
            raise ValueError(f"{where}: this field has no meaning for local processes")
    return table


def _table(value: Any, path: str) -> Table:
    if not isinstance(value, dict):
        raise ValueError(f"{path}: expected a map of names, got {type(value).__name__}")
    for name in value:
        if not isinstance(name, str):  # YAML reads off, on, yes and no as booleans
            raise ValueError(f"{path}: expected text as a name, got {name!r}; put it in quotes")
    return value
