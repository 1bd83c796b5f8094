"""The one way to run a node as a process: flags, configuration, bus, signals, exit code."""

import argparse
import faulthandler
import logging
import os
import re
import signal
import socket
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import cv2
import msgspec

from common.config import load
from common.runtime.assignment import CAPACITY_MAX
from common.runtime.checkpoint import FOLDER
from common.runtime.loop import Loop, LoopSettings
from common.runtime.node import Node
from common.runtime.process_id import Place
from common.transport.clock import keep_time
from common.transport.zenoh_bus import ZenohBus, read_config
from people4d.errors import People4dError

T = TypeVar("T", bound=msgspec.Struct)

# A thread that received a frame, or whose network has run, must not wait 5 ms (the default) until
# another thread lets go of the interpreter.
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
    """Run one service until it is finished or told to stop (SIGTERM, SIGINT).

    Args:
        service: Name of the service and of its table in the configuration file.
        kind: Record of its configuration.
        build: Makes the node from the configuration.
        workers: Threads that handle messages at once; more than one needs a thread-safe node.
        mode: Shipped Zenoh configuration that is used when none is given.
        arguments: Command line, None for the process's own.

    Returns:
        Exit code: 0 done, 1 a failure that was told in one sentence.
    """
    flags = _parser(service).parse_args(arguments)
    logging.basicConfig(
        level=logging.DEBUG if flags.debug else logging.INFO,
        format=f"%(asctime)s {flags.instance} %(levelname)s %(message)s",
        stream=sys.stderr,
    )
    cv2.setNumThreads(1)
    sys.setswitchinterval(SWITCH_S)
    faulthandler.register(signal.SIGUSR2, all_threads=True)  # says where it hangs
    _on_stop_signals(lambda: sys.exit(0))  # until there is a loop to stop
    try:
        config = load(kind, service, flags.config, flags.set)
        bus = ZenohBus(read_config(flags.zenoh, mode, role=service), flags.robot)
        try:
            node = build(config)
            place = Place(service, flags.instance, socket.gethostname(), flags.capacity)
            if mode == "router":  # everyone reaches it
                keep_time(bus)
            loop = Loop(node, bus, place, _loop_settings(workers))
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


def _loop_settings(workers: int, environment: Mapping[str, str] = os.environ) -> LoopSettings:
    folder = environment.get(FOLDER)
    return LoopSettings(
        workers=workers,
        traced=environment.get("PEOPLE4D_TRACE") != "off",
        state_folder=Path(folder) if folder else None,
    )


def _on_stop_signals(stop: Callable[[], None]) -> None:
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop())


def _capacity(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= CAPACITY_MAX:
        raise argparse.ArgumentTypeError(f"expected 1 to {CAPACITY_MAX}, got {text!r}")
    return int(text)


def _instance(service: str) -> str:
    """Return a name that no other has: in containers all processes have the same number."""
    host = re.sub(r"[^A-Za-z0-9.-]", "-", socket.gethostname())[:32]
    return f"{service}-{host}-{os.getpid()}"


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
        default=environment.get("PEOPLE4D_INSTANCE") or _instance(service),
        help="name of this process, unique on the robot; default $PEOPLE4D_INSTANCE",
    )
    parser.add_argument(
        "--zenoh",
        type=Path,
        default=None,
        help="Zenoh configuration: a JSON5 file, or a folder with one for each role; "
        "default $PEOPLE4D_ZENOH or the shipped ones",
    )
    parser.add_argument(
        "--capacity",
        type=_capacity,
        default=environment.get("PEOPLE4D_CAPACITY") or "1",
        help="speed beside that of its replicas, 1 to 100; default $PEOPLE4D_CAPACITY or 1",
    )
    parser.add_argument("--debug", action="store_true", help="show traces and debug messages")
    return parser
