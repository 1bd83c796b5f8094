"""Several services in one process, joined in memory.

Each service has its own loop, thread, heartbeat, replicas and checkpoint under its own name. All
services share one Zenoh session. A message between two services is passed without encoding; it is
encoded only for other processes.
"""

import logging
import os
import threading
from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

from common.config import load
from common.inference.cores import DETECTOR
from common.runtime.loop import Loop
from common.runtime.node import Node
from common.runtime.process import (
    loop_settings,
    on_stop_signals,
    parser,
    prepare,
    process_ids,
    release_memory,
)
from common.runtime.threads import THREADS
from common.transport.exchange import Exchange
from common.transport.trace import JOINED, ProcessId
from common.transport.zenoh_bus import ZenohBus, read_config
from people4d.errors import ConfigError, People4dError
from people4d.topics import TOPICS

log = logging.getLogger("people4d")


@dataclass(frozen=True)
class ServiceBuild:
    """Build of a service's node from its configuration."""

    service: str  # name of the service and of its table in the configuration file
    config: type[Any]  # record of its configuration
    build: Callable[[Any], Node]  # builds the node from the configuration


def main(
    module: str,
    find: Callable[[Sequence[str]], list[ServiceBuild]],
    arguments: Sequence[str] | None = None,
) -> int:
    """Run several services until one is finished or the process is stopped (SIGTERM, SIGINT).

    Then all end, producers first, so their last messages are handled.

    Args:
        module: Module that the process runs.
        find: Returns the builds of services; raises ConfigError if they may not share a process.
        arguments: Command line, None for the process's own.

    Returns:
        Exit code: 0 done, 1 a failure, logged in one sentence.
    """
    options = parser(module, "Run several services in one process, joined in memory.")
    options.add_argument("services", nargs="+", metavar="SERVICE", help="their names")
    flags = options.parse_intermixed_args(arguments)
    prepare(flags.instance or JOINED.join(flags.services), flags.debug)
    try:
        DETECTOR.reserve(os.environ)
        builds = find(flags.services)
        ids = process_ids(flags.services, flags.instance)
        config = read_config(flags.zenoh, "peer", role=flags.services[0])
        bus = ZenohBus(config, flags.robot, exchange=Exchange())
        try:
            loops = _loops(builds, ids, bus, flags)
            release_memory()
            return _run(loops)
        finally:
            bus.close()
    except People4dError as error:
        log.error("%s", error, exc_info=flags.debug)
        return 1


def _loops(
    builds: Sequence[ServiceBuild], ids: Sequence[ProcessId], bus: ZenohBus, flags: Namespace
) -> dict[str, Loop]:
    """Build all nodes and their loops; return them by instance, producers first."""
    settings: dict[str, list[str]] = {one.service: [] for one in builds}
    for text in flags.set:
        service, _, setting = text.partition(".")
        if service not in settings:
            raise ConfigError(
                f"setting {text!r} names no running service", "Write service.field=value."
            )
        settings[service].append(setting)
    loops = {}
    for one, identity in sorted(
        zip(builds, ids, strict=True), key=lambda pair: _rank(pair[0].service)
    ):
        config = load(one.config, one.service, flags.config, settings[one.service])
        node = one.build(config)
        loops[identity.instance] = Loop(node, bus, identity, loop_settings(node, flags))
    return loops


def _rank(service: str) -> int:
    """Return the position of a service in the flow of data, by its first published topic."""
    ranks = (rank for rank, topic in enumerate(TOPICS) if service in topic.producers)
    return next(ranks, len(TOPICS))


def _run(loops: dict[str, Loop]) -> int:
    """Run the loops, each in its thread, until one ends; return the exit code."""
    ended: SimpleQueue[None] = SimpleQueue()  # reentrant: a signal handler puts into it
    failed: list[str] = []

    def run(instance: str, loop: Loop) -> None:
        try:
            loop.run()
        except Exception:
            log.exception("%s failed", instance)
            failed.append(instance)
        finally:
            loop.ready.set()
            ended.put(None)

    on_stop_signals(lambda: ended.put(None))
    threads = {}
    # Consumers first, so that no consumer misses a message.
    for instance, loop in reversed(loops.items()):
        threads[instance] = threading.Thread(target=run, args=(instance, loop), name=instance)
        threads[instance].start()
        loop.ready.wait()
    log.info("started")
    ended.get()
    for instance, loop in loops.items():
        loop.stop()
        threads[instance].join()
    log.info("stopped")
    return 1 if failed else THREADS.exit_code
