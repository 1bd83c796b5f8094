"""Plan of a run: services to start, from the options of the user."""

import importlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import msgspec

from common.calibration.transforms_file import read_pose, read_transforms
from common.config import load, setting
from deploy import compose
from deploy.compose import Service
from deploy.launcher.joined import check_joinable, config_record, join, joined_command
from people4d.errors import ConfigError
from services.camera.config import CameraConfig

COMPOSE_FILE = Path(__file__).resolve().parents[1] / "compose.yaml"
CONFIG_FILE = COMPOSE_FILE.parent / "config" / "people4d.toml"
REPORT = "report"  # profile and service of the report
PROCESSES = "processes"  # profile of services for local processes only
CAMERA = "camera"
ROUTER = "router"
HOST = "127.0.0.1"
PORT = 7447
REPLICAS_PER_CORE = 4  # maximum number of replicas of a service, against typing errors


@dataclass(frozen=True)
class LaunchRequest:
    """Launch request: options of `people4d up`."""

    robot: str = "robot"  # name of the robot
    host: str = HOST  # address of the router; 0.0.0.0 lets other hosts connect
    port: int = PORT  # TCP port of the router
    # TOML file with one table for each service; None for the shipped one
    config: Path | None = None
    compose: Path = COMPOSE_FILE  # compose file
    settings: Sequence[str] = ()  # "service.field=value", the last one of a field wins
    scale: Sequence[str] = ()  # "service=number"
    report: Path | None = None  # folder for a report, None for none
    profiles: Sequence[str] = ()  # profiles of the compose file, for example "gait"
    together: Sequence[str] = ()  # services in one process
    # the caller's environment variables
    environment: Mapping[str, str] = field(default_factory=lambda: dict(os.environ))

    @property
    def connect(self) -> str:
        """Endpoint of the router for processes on this machine."""
        return f"tcp/{HOST if self.host == '0.0.0.0' else self.host}:{self.port}"


def config_file(environment: Mapping[str, str]) -> Path:
    """Return the file of the settings: $PEOPLE4D_CONFIG, else the shipped one."""
    return Path(environment.get("PEOPLE4D_CONFIG") or CONFIG_FILE)


def plan(request: LaunchRequest) -> tuple[Service, ...]:
    """Return the services of a request in start order; ConfigError if the request is wrong."""
    settings = list(request.settings)
    profiles = {PROCESSES, *request.profiles}
    if request.report:
        settings.append(setting(f"{REPORT}.folder", str(request.report.absolute())))
        profiles.add(REPORT)
    every = compose.read(request.compose, variables(request))
    services = compose.select(every, profiles)
    if request.together:
        for name in request.together:
            _check_runs(name, services, every)
        check_joinable(request.together, every, request.environment)
        services = compose.select(join(services, request.together), profiles)
    arguments = _arguments(settings, services, every)
    replicas = replicas_of(request.scale, services, every)
    planned = []
    for service in services:
        name, overrides = service.name, [("--set", text) for text in arguments[service.name]]
        command = (*service.command, *chain.from_iterable(overrides))
        planned.append(replace(service, command=command, replicas=replicas[name]))
        if request.report and name == CAMERA:
            # A report covers one pass of the recording, so the camera is not restarted.
            planned[-1] = replace(planned[-1], restart="no", retries=0)
    for service in planned:
        if service.partners:
            # Raises ConfigError for services that cannot be joined
            joined_command(service.partners, planned)
    return tuple(planned)


def router_of(services: Sequence[Service], request: LaunchRequest) -> str:
    """Return the endpoint of the router of these services, or of another host."""
    if any(service.name == ROUTER for service in services):
        return request.connect
    return request.environment.get("PEOPLE4D_CONNECT") or request.connect


def variables(request: LaunchRequest) -> dict[str, str]:
    """Return the values of the variables of the compose file on this host."""
    config = request.config or config_file(request.environment)
    if not config.is_file():
        raise ConfigError(f"configuration file {config} does not exist", "Check the path.")
    local = {
        "PEOPLE4D_ROUTER_LISTEN": f"tcp/{request.host}:{request.port}",
        "PEOPLE4D_PEER_LISTEN": "tcp/127.0.0.1:0",
    }
    fixed = {
        "PEOPLE4D_ROBOT": request.robot,
        "PEOPLE4D_CONFIG_INSIDE": str(config.absolute()),
        "PEOPLE4D_CONNECT_INSIDE": request.connect,
    }
    keys = request.environment.get("PEOPLE4D_KEYS")
    if keys:  # path on this host; it differs in a container
        fixed["PEOPLE4D_KEYS_INSIDE"] = str(Path(keys).absolute())
    return local | dict(request.environment) | fixed


def check_settings(services: Sequence[Service], request: LaunchRequest) -> None:
    """Check the settings of services, and the sources, models, files and folders in them.

    People4dError if a setting is wrong, or its source, model, file or folder is unusable.
    """
    file = Path(variables(request)["PEOPLE4D_CONFIG_INSIDE"])
    for service in services:
        environment = {**request.environment, **service.environment}
        overrides = [text for flag, text in pairwise(service.command) if flag == "--set"]
        settings = read_settings(service, file, environment, overrides)
        location = service.labels.get("people4d.check")
        if settings and service.replicas and location:
            _find(location)(settings)
        if service.replicas and isinstance(settings, CameraConfig) and settings.transforms:
            _check_transforms(Path(settings.transforms), settings.camera)


def _check_transforms(file: Path, camera: str) -> None:
    if not file.is_file():
        raise ConfigError(f"transforms {file} does not exist", "Check the path.")
    read_pose(file, camera) if camera else read_transforms(file)


def read_settings(
    service: Service, file: Path, environment: Mapping[str, str], overrides: Sequence[str] = ()
) -> msgspec.Struct | None:
    """Read the settings of a service exactly as its process does.

    The configuration is None for a program that is not a service of this project. Overrides,
    "field=value", win over the environment of the process, and the environment over the TOML file.
    ConfigError if a setting is unknown or out of range, or the file cannot be read.
    """
    if not service.module.startswith("services."):
        return None
    name = service.module.rpartition(".")[2]
    return load(config_record(name), name, file, overrides, environment)


def load_model(service: Service, settings: msgspec.Struct) -> str:
    """Load the model of a service and return its name; People4dError if it cannot be loaded."""
    _find(service.labels["people4d.model"])(settings)
    fields = msgspec.structs.asdict(settings)
    return str(fields.get("model") or fields.get("embedder"))


def _find(location: str) -> Any:
    module, _, name = location.partition(":")
    return getattr(importlib.import_module(module), name)


def _arguments(
    settings: Sequence[str], services: Sequence[Service], every: Sequence[Service]
) -> dict[str, list[str]]:
    """Return the overrides of each service, "field=value"."""
    arguments: dict[str, list[str]] = {service.name: [] for service in services}
    for text in settings:
        path, separator, value = text.partition("=")
        name, dot, field_name = path.strip().partition(".")
        if not (separator and dot and field_name):
            raise ConfigError(f"setting {text!r} is incomplete", "Write service.field=value.")
        _check_runs(name, services, every)
        arguments[name].append(f"{field_name}={value}")
    return arguments


def replicas_of(
    scale: Sequence[str], services: Sequence[Service], every: Sequence[Service] = ()
) -> dict[str, int]:
    """Return the number of processes of each service.

    The last "service=number" of a service wins; the default is the number in the plan. ConfigError
    if a request names no service, or several processes of a single-process service.
    """
    by_name = {service.name: service for service in services}
    replicas = {service.name: service.replicas for service in services}
    for text in scale:
        name, _, number = text.partition("=")
        if not number.isdecimal():
            raise ConfigError(f"scale {text!r} is incomplete", "Write service=number.")
        _check_runs(name, services, every)
        if int(number) > 1 and not by_name[name].has("scalable"):
            scalable = " and ".join(one.name for one in services if one.has("scalable"))
            raise ConfigError(
                f"{name} runs once: two would do the same work twice",
                f"Services that share their work are {scalable}.",
            )
        if int(number) < 1 and by_name[name].has("needed"):
            raise ConfigError(f"{text}: no people are tracked without {name}", f"Write {name}=1.")
        if int(number) < 1 and by_name[name].partners:
            others = ", ".join(other for other in by_name[name].partners if other != name)
            raise ConfigError(f"{name} is in one process with {others}, which would end, too")
        cores = len(os.sched_getaffinity(0))
        if int(number) > REPLICAS_PER_CORE * cores:
            raise ConfigError(
                f"{text}: this machine has {cores} cores",
                f"Ask for {REPLICAS_PER_CORE * cores} at most; more than {cores} are slower.",
            )
        replicas[name] = int(number)
    return replicas


def _check_runs(name: str, services: Sequence[Service], every: Sequence[Service]) -> None:
    if any(service.name == name for service in services):
        return
    for service in every:
        if service.name == name:
            raise ConfigError(f"{name} is not enabled", f"Add {service.option}.")
    names = ", ".join(service.name for service in services)
    raise ConfigError(f"unknown service {name!r}", f"Services are {names}.")
