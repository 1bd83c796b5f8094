"""Plans with several services in one process."""

import importlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace

import msgspec

from common.transport.trace import JOINED
from deploy.compose import CONDITIONS, Dependency, Service
from people4d.errors import ConfigError

MODULE = "deploy.joined"  # module of a process with several services
INSTANCE = "PEOPLE4D_INSTANCE"  # variable with the name of a process


def config_record(service: str) -> type[msgspec.Struct]:
    """Return the record of a service's configuration."""
    record: type[msgspec.Struct] = getattr(
        importlib.import_module(f"services.{service}.config"),
        f"{service.title().replace('_', '')}Config",
    )
    return record


def check_joinable(
    names: Sequence[str], services: Sequence[Service], environment: Mapping[str, str] = os.environ
) -> None:
    """Check that some of the services may share a process.

    ConfigError if a service may not share, is named twice, is alone, or has to prove its role.
    """
    joinable = [service.name for service in services if service.has("joinable")]
    can = f"Those that can are {', '.join(joinable)}."
    for name in names:
        if name not in joinable:
            raise ConfigError(f"{name!r} cannot share a process with others", can)
        if names.count(name) > 1:
            raise ConfigError(f"{name} is named twice among {', '.join(names)}", can)
    if len(names) < 2:
        raise ConfigError(f"{', '.join(names)} alone: nothing to join", can)
    if environment.get("PEOPLE4D_KEYS"):
        raise ConfigError(
            "with PEOPLE4D_KEYS each service proves its role, which one process cannot for several",
            "Leave out --together, or PEOPLE4D_KEYS.",
        )


def join(services: Sequence[Service], names: Sequence[str]) -> tuple[Service, ...]:
    """Return services with partners set; the shared process has the dependencies of all."""
    waits: dict[str, Dependency] = {}
    for service in services:
        for dependency in service.depends_on if service.name in names else ():
            if dependency.service not in names:
                waits[dependency.service] = max(
                    dependency,
                    waits.get(dependency.service, dependency),
                    key=lambda d: CONDITIONS.index(d.condition),
                )
    partners = tuple(names)
    return tuple(
        replace(service, partners=partners, depends_on=tuple(waits.values()))
        if service.name in names
        else service
        for service in services
    )


def joined_command(names: Sequence[str], services: Sequence[Service]) -> tuple[str, ...]:
    """Return the command of a shared process, with the settings of its services.

    ConfigError if a service does not run its module, or two services need different values of an
    environment variable.
    """
    by_name = {service.name: service for service in services}
    command = ["python", "-m", MODULE, *names]
    values: dict[str, str] = {}
    for service in (by_name[name] for name in names):
        own = f"services.{service.name}"
        start, settings = service.command[:3], service.command[3:]
        if start != ("python", "-m", own) or set(settings[::2]) - {"--set"}:
            raise ConfigError(f"{service.name} does not run as python -m {own}, so it runs alone")
        for text in settings[1::2]:
            command += ["--set", f"{service.name}.{text}"]
        for name, value in service.environment.items():
            if values.setdefault(name, value) != value and name != INSTANCE:
                raise ConfigError(f"{service.name} needs another {name} than the others")
    return tuple(command)


def joined_service(service: Service, services: Sequence[Service]) -> tuple[Service, str]:
    """Return supervisord's service of a shared process, and the process name."""
    by_name = {one.name: one for one in services}
    all_of = [by_name[name] for name in service.partners]
    program = replace(
        service,
        command=joined_command(service.partners, services),
        environment={name: text for one in all_of for name, text in one.environment.items()},
        restart="no" if any(one.restart == "no" for one in all_of) else service.restart,
        stop_grace_s=max(one.stop_grace_s for one in all_of),
    )
    return program, JOINED.join(one.instances[0] for one in all_of)
