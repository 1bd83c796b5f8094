"""Several services in one process: `python -m deploy.joined detector reid tracker`."""

import importlib
import sys
from collections.abc import Sequence
from typing import Any

from common.runtime import joined
from common.runtime.joined import ServiceBuild
from deploy import compose
from deploy.launcher.joined import check_joinable, config_record
from deploy.launcher.plan import COMPOSE_FILE


def find(services: Sequence[str]) -> list[ServiceBuild]:
    """Return the builds of services that may share a process, or raise ConfigError."""
    check_joinable(services, compose.read(COMPOSE_FILE, {}))
    return [_find(service) for service in services]


def _find(service: str) -> ServiceBuild:
    build: Any = importlib.import_module(f"services.{service}.build")
    return ServiceBuild(
        service=service,
        config=config_record(service),
        build=getattr(build, "build_compiled", build.build),
    )


if __name__ == "__main__":
    sys.exit(joined.main("deploy.joined", find))
