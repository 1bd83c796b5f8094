"""Run of a node as a process: flags, configuration, bus, signals, exit code."""

import argparse
import ctypes
import faulthandler
import gc
import logging
import os
import re
import signal
import socket
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import cv2
import msgspec

from common.config import load
from common.inference.cores import DETECTOR
from common.runtime.checkpoint import FOLDER, state_folder
from common.runtime.loop import Loop, LoopSettings
from common.runtime.node import Node
from common.runtime.threads import THREADS
from common.transport.clock import serve_time
from common.transport.trace import JOINED, ProcessId
from common.transport.zenoh_bus import ZenohBus, read_config
from people4d.errors import ConfigError, People4dError

T = TypeVar("T", bound=msgspec.Struct)

SWITCH_S = 0.0005  # switch interval of the interpreter; the default delays a frame by 5 ms [s]

log = logging.getLogger("people4d")


def main(
    service: str,
    kind: type[T],
    build: Callable[[T], Node],
    mode: str = "peer",
    arguments: Sequence[str] | None = None,
) -> int:
    """Run one service until it is finished or stopped (SIGTERM, SIGINT).

    Args:
        service: Name of the service and of its table in the configuration file.
        kind: Record of its configuration.
        build: Makes the node from the configuration.
        mode: Shipped Zenoh configuration used by default.
        arguments: Command line, None for the process's own.

    Returns:
        Exit code: 0 done, 1 a failure, logged in one sentence.
    """
    flags = parser(f"services.{service}", f"Run the {service} service.").parse_args(arguments)
    (process_id,) = process_ids([service], flags.instance)
    prepare(process_id.instance, flags.debug)
    try:
        DETECTOR.reserve(os.environ)
        config = load(kind, service, flags.config, flags.set)
        bus = ZenohBus(read_config(flags.zenoh, mode, role=service), flags.robot)
        try:
            node = build(config)
            release_memory()
            if mode == "router":  # router: the process that all others connect to
                serve_time(bus)
            loop = Loop(node, bus, process_id, loop_settings(node, flags))
            on_stop_signals(loop.stop)
            log.info("started")
            loop.run()
            log.info("stopped")
            return THREADS.exit_code
        finally:
            bus.close()
    except People4dError as error:
        log.error("%s", error, exc_info=flags.debug)
        return 1


def prepare(name: str, debug: bool) -> None:
    """Set up log, libraries, signal handlers and thread monitoring of this process."""
    logging.basicConfig(
        level=logging.DEBUG if debug else logging.INFO,
        format=f"%(asctime)s {name} %(levelname)s %(message)s",
        stream=sys.stderr,
    )
    cv2.setNumThreads(1)
    sys.setswitchinterval(SWITCH_S)
    faulthandler.register(signal.SIGUSR2, all_threads=True)  # dumps all stacks
    on_stop_signals(lambda: sys.exit(THREADS.exit_code))  # until a loop runs
    THREADS.watch()


def process_ids(services: Sequence[str], instance: str | None) -> list[ProcessId]:
    """Return the identities of the services of this process.

    Args:
        services: Their names.
        instance: Instance names, separated by +; None or empty: new names.
    """
    host = socket.gethostname()
    given = instance.split(JOINED) if instance else [_instance(s, host) for s in services]
    if len(given) != len(services):
        raise ConfigError(
            f"instance {instance!r} names {len(given)} of {len(services)} services",
            f"Name one for each service, with {JOINED} between.",
        )
    return [ProcessId(s, name, host) for s, name in zip(services, given, strict=True)]


def loop_settings(node: Node, flags: argparse.Namespace) -> LoopSettings:
    """Return the settings of a node's loop."""
    # Generated names are not reused, except in a container.
    resumable = flags.instance or os.environ.get(FOLDER)
    return LoopSettings(
        workers=node.workers,
        traced=os.environ.get("PEOPLE4D_TRACE") != "off",
        state_folder=state_folder(flags.robot) if resumable else None,
    )


def release_memory() -> None:
    """Release the memory of loading, and exclude loaded objects from garbage collection.

    A full collection of the objects of all modules takes 60 ms, during a frame.
    """
    gc.collect()
    gc.freeze()
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def on_stop_signals(stop: Callable[[], None]) -> None:
    """Call `stop` when this process is asked to end."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop())


def _instance(service: str, host: str) -> str:
    """Return a unique name; process numbers are the same in all containers."""
    return f"{service}-{re.sub(r'[^A-Za-z0-9.-]', '-', host)[:32]}-{os.getpid()}"


def parser(module: str, description: str) -> argparse.ArgumentParser:
    """Return a parser of the options of every process."""
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=description)
    environment = os.environ
    config = environment.get("PEOPLE4D_CONFIG")
    parser.add_argument(
        "--config",
        type=Path,
        default=Path(config) if config else None,
        help="TOML file with a table for each service; default $PEOPLE4D_CONFIG",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="FIELD=VALUE",
        help="override one field of the configuration; may be repeated",
    )
    parser.add_argument(
        "--robot",
        default=environment.get("PEOPLE4D_ROBOT") or "robot",
        help="name of the robot, part of every key; default $PEOPLE4D_ROBOT or robot",
    )
    parser.add_argument(
        "--instance",
        default=environment.get("PEOPLE4D_INSTANCE"),
        help="name of this process, unique on the robot; default $PEOPLE4D_INSTANCE or a new one",
    )
    parser.add_argument(
        "--zenoh",
        type=Path,
        default=None,
        help="Zenoh configuration: a JSON5 file, or a folder with one for each role; "
        "default $PEOPLE4D_ZENOH or the shipped ones",
    )
    parser.add_argument("--debug", action="store_true", help="show traces and debug messages")
    return parser
