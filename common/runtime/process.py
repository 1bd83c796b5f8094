"""The one way to run a node as a process: flags, configuration, bus, signals, exit code."""

import argparse
import faulthandler
import logging
import os
import re
import signal
import socket
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import cv2
import msgspec

from common.config import load
from common.runtime.checkpoint import FOLDER, state_folder
from common.runtime.loop import Loop, LoopSettings
from common.runtime.node import Node
from common.transport.clock import serve_time
from common.transport.trace import ProcessId
from common.transport.zenoh_bus import ZenohBus, read_config
from people4d.errors import People4dError

T = TypeVar("T", bound=msgspec.Struct)

# A thread that received a frame, or whose network has run, must not wait 5 ms (the default) until
# another thread releases the interpreter.
SWITCH_S = 0.0005

log = logging.getLogger("people4d")


def main(
    service: str,
    kind: type[T],
    build: Callable[[T], Node],
    workers: int = 1,
    mode: str = "peer",
    arguments: Sequence[str] | None = None,
) -> int:
    """Run one service until it is finished or stopped (SIGTERM, SIGINT).

    Args:
        service: Name of the service and of its table in the configuration file.
        kind: Record of its configuration.
        build: Makes the node from the configuration.
        workers: Threads that handle messages at once; more than one needs a thread-safe node.
        mode: Shipped Zenoh configuration that is used when none is given.
        arguments: Command line, None for the process's own.

    Returns:
        Exit code: 0 done, 1 a failure, logged in one sentence.
    """
    flags = _parser(service).parse_args(arguments)
    host = socket.gethostname()
    process_id = ProcessId(service, flags.instance or _instance(service, host), host)
    logging.basicConfig(
        level=logging.DEBUG if flags.debug else logging.INFO,
        format=f"%(asctime)s {process_id.instance} %(levelname)s %(message)s",
        stream=sys.stderr,
    )
    cv2.setNumThreads(1)
    sys.setswitchinterval(SWITCH_S)
    faulthandler.register(signal.SIGUSR2, all_threads=True)  # dumps all stacks
    _on_stop_signals(lambda: sys.exit(0))  # until there is a loop to stop
    try:
        config = load(kind, service, flags.config, flags.set)
        bus = ZenohBus(read_config(flags.zenoh, mode, role=service), flags.robot)
        try:
            node = build(config)
            if mode == "router":  # all processes reach it
                serve_time(bus)
            loop = Loop(node, bus, process_id, _loop_settings(workers, flags))
            _on_stop_signals(loop.stop)
            log.info("started")
            loop.run()
            log.info("stopped")
        finally:
            bus.close()
    except People4dError as error:
        log.error("%s", error, exc_info=flags.debug)
        return 1
    return 0


def _loop_settings(workers: int, flags: argparse.Namespace) -> LoopSettings:
    # A name made for this process is that of no later one, unless a container gives it again.
    resumable = flags.instance or os.environ.get(FOLDER)
    return LoopSettings(
        workers=workers,
        traced=os.environ.get("PEOPLE4D_TRACE") != "off",
        state_folder=state_folder(flags.robot) if resumable else None,
    )


def _on_stop_signals(stop: Callable[[], None]) -> None:
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop())


def _instance(service: str, host: str) -> str:
    """Return a unique name: in containers all processes have the same number."""
    return f"{service}-{re.sub(r'[^A-Za-z0-9.-]', '-', host)[:32]}-{os.getpid()}"


def _parser(service: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=f"python -m services.{service}", description=f"Run the {service} service."
    )
    environment = os.environ
    config = environment.get("PEOPLE4D_CONFIG")
    parser.add_argument(
        "--config",
        type=Path,
        default=Path(config) if config else None,
        help=f"TOML file, table [{service}]; default $PEOPLE4D_CONFIG",
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
