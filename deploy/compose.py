"""The part of a compose file that says what runs: read, checked, frozen.

The file stays valid for docker compose. Fields that only shape a container are passed over here;
a field that would change what runs, and that is not known, is an error.
"""

import re
import shlex
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

from deploy import compose_file
from deploy.compose_file import interpolate
from people4d.errors import ConfigError

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

DURATION = re.compile(r"(?:(\d+)h)?(?:(\d+)m(?!s))?(?:(\d+(?:\.\d+)?)s)?(?:(\d+)ms)?")

Table = Mapping[str, Any]


@dataclass(frozen=True)
class Dependency:
    """Condition that another service must meet before a service is started."""

    service: str  # name of the other service
    condition: str  # one of CONDITIONS
    required: bool  # false: without effect where the other service is not part of the run


@dataclass(frozen=True)
class Healthcheck:
    """A command that exits 0 while its service is healthy."""

    test: tuple[str, ...]  # the command, one string per argument
    interval_s: float  # pause between two checks
    timeout_s: float  # longest time that one check may take


@dataclass(frozen=True)
class Service:
    """One service of the system."""

    name: str  # its name
    command: tuple[str, ...]  # command, one string per argument
    environment: Mapping[str, str]  # environment variables beside the caller's own
    depends_on: tuple[Dependency, ...]  # what it waits for
    healthcheck: Healthcheck | None  # how to know that it is healthy, None if running is enough
    restart: str  # one of RESTARTS
    retries: int  # failed starts in a row after which it is given up
    replicas: int  # number of equal processes
    stop_grace_s: float  # time between SIGTERM and SIGKILL
    profiles: frozenset[str]  # it runs only with one of these profiles; empty: always
    # further facts: `people4d.scalable` (its replicas share their work), `people4d.option` (how it
    # is asked for), `people4d.model` (loader of its model)
    labels: Mapping[str, str] = field(default_factory=dict)

    @property
    def module(self) -> str:
        """Python module that it runs; empty if it is another program."""
        program, *arguments = self.command
        is_module = program.startswith("python") and "-m" in arguments
        return arguments[arguments.index("-m") + 1] if is_module else ""

    @property
    def scalable(self) -> bool:
        """True if several equal processes share its work."""
        return self.labels.get("people4d.scalable") == "true"

    @property
    def option(self) -> str:
        """Command-line option that asks for it; empty if it always runs."""
        named = self.labels.get("people4d.option", "")
        return named or (f"--profile {min(self.profiles)}" if self.profiles else "")

    @property
    def instances(self) -> tuple[str, ...]:
        """Names of its processes: detector-1, detector-2."""
        return tuple(f"{self.name}-{n}" for n in range(1, self.replicas + 1))


def read(file: Path, variables: Mapping[str, str]) -> tuple[Service, ...]:
    """Read the services of a compose file, those of every profile.

    Args:
        file: The compose file.
        variables: Values for ${VAR}.

    Raises:
        ConfigError: The file cannot be read, or says what only a container could do.
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
    """Return the services of a run, in an order in which they can be started.

    Args:
        services: Those of a compose file.
        profiles: Profiles whose services run beside those without a profile.

    Raises:
        ConfigError: A dependency is unknown, or services wait for each other.
    """
    try:
        return start_order(_part_of_run(services, profiles))
    except ValueError as error:
        raise ConfigError(f"compose file: {error}") from error


def start_order(services: tuple[Service, ...]) -> tuple[Service, ...]:
    """Order services so that each comes after those it depends on.

    Raises:
        ValueError: A dependency is unknown, or services wait for each other.
    """
    by_name = {service.name: service for service in services}
    for service in services:
        for other in service.depends_on:
            if other.service not in by_name:
                raise ValueError(f"{service.name} depends on {other.service}, which does not run")
    graph = {s.name: [d.service for d in s.depends_on] for s in services}
    try:
        return tuple(by_name[name] for name in TopologicalSorter(graph).static_order())
    except CycleError as error:
        raise ValueError(f"services wait for each other: {' -> '.join(error.args[1])}") from error


def _part_of_run(services: Sequence[Service], profiles: Set[str]) -> tuple[Service, ...]:
    """Leave out services of other profiles, and what is optional and waits for them."""
    running = [s for s in services if not s.profiles or s.profiles & profiles]
    names = {service.name for service in running}
    return tuple(
        replace(s, depends_on=tuple(d for d in s.depends_on if d.required or d.service in names))
        for s in running
    )


def _service(name: str, value: Any) -> Service:
    fields = _fields(value, USED, CONTAINER_ONLY, name)
    if not fields.get("command"):
        raise ValueError(f"{name}: expected a command, got none")
    restart, _, retries = str(fields.get("restart") or "no").partition(":")
    if restart not in RESTARTS or (retries and not retries.isdecimal()):
        raise ValueError(f"{name}.restart: expected one of {', '.join(RESTARTS)}, got {restart!r}")
    deploy = _fields(fields.get("deploy", {}), USED_DEPLOY, CONTAINER_ONLY_DEPLOY, f"{name}.deploy")
    replicas = str(deploy.get("replicas", 1))
    if not replicas.isdecimal():
        raise ValueError(f"{name}.deploy.replicas: expected a number >= 0, got {replicas!r}")
    return Service(
        name=name,
        command=_command(fields["command"], f"{name}.command"),
        environment=_environment(fields.get("environment", {}), f"{name}.environment"),
        depends_on=_dependencies(fields.get("depends_on", {}), f"{name}.depends_on"),
        healthcheck=_healthcheck(fields.get("healthcheck"), f"{name}.healthcheck"),
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


def _healthcheck(value: Any, path: str) -> Healthcheck | None:
    if value is None:
        return None
    timing = frozenset({"start_period", "start_interval", "retries"})
    fields = _fields(value, frozenset({"test", "interval", "timeout", "disable"}), timing, path)
    test = fields.get("test") or ["NONE"]
    if fields.get("disable") or test == ["NONE"]:
        return None
    if isinstance(test, str):
        test = ["CMD-SHELL", test]
    kind, *command = map(str, test)
    if kind not in ("CMD", "CMD-SHELL") or not command:
        raise ValueError(f"{path}.test: expected [CMD, ...] or [CMD-SHELL, ...], got {test}")
    return Healthcheck(
        test=tuple(command if kind == "CMD" else ["sh", "-c", *command]),
        interval_s=_seconds(fields.get("interval", "30s"), f"{path}.interval"),
        timeout_s=_seconds(fields.get("timeout", "30s"), f"{path}.timeout"),
    )


def _command(value: Any, path: str) -> tuple[str, ...]:
    if isinstance(value, str):
        return tuple(shlex.split(value))
    if not isinstance(value, list):
        raise ValueError(f"{path}: expected a list of arguments, got {value!r}")
    return tuple(map(str, value))


def _environment(value: Any, path: str) -> dict[str, str]:
    if isinstance(value, list):
        value = dict(str(item).partition("=")[::2] for item in value if "=" in str(item))
    # A name without a value stands for the caller's own, which a local process inherits anyway.
    return {
        key: str(item).lower() if isinstance(item, bool) else str(item)
        for key, item in _table(value, path).items()
        if item is not None
    }


def _seconds(value: Any, path: str) -> float:
    match = DURATION.fullmatch(str(value))
    if not match or not any(match.groups()):
        raise ValueError(f"{path}: expected a duration such as 10s or 1m30s, got {value!r}")
    hours, minutes, seconds, milliseconds = (float(group or 0) for group in match.groups())
    return hours * 3600 + minutes * 60 + seconds + milliseconds / 1000


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
        if not isinstance(name, str):  # YAML reads off, on, yes and no as truth values
            raise ValueError(f"{path}: expected text as a name, got {name!r}; put it in quotes")
    return value
