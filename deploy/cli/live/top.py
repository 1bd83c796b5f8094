"""Command `people4d top`."""

import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Annotated

import msgspec
import typer
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from common.runtime.monitor import (
    ClockSnapshot,
    Durations,
    Monitor,
    ProcessSnapshot,
    SystemSnapshot,
)
from common.transport.trace import ProcessId
from deploy.cli.options import Connect, Json, Robot, open_client
from deploy.cli.terminal import coloured_state, plain_table, print_json, shown
from people4d.client import Client
from people4d.errors import People4dError
from people4d.topics import TOPICS

STREAMS = tuple(topic.name for topic in TOPICS if topic.rate_hz)  # periodic topics
WIDTH = 120  # width without a terminal [characters]
HERE = "here"  # name of this command as a service in the table
FIRST_S = 3.0  # minimum duration of --once: heartbeats come twice a second [s]


def top(
    seconds: Annotated[
        float, typer.Option("--window", min=1, help="Period of the figures of stages, in seconds.")
    ] = 10.0,
    every_s: Annotated[
        float, typer.Option("--every", min=0.2, help="Seconds between snapshots.")
    ] = 1,
    once: Annotated[bool, typer.Option("--once", help="Show one snapshot and exit.")] = False,
    json: Json = False,
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Show the duration of every stage, rates, losses, ages, processor and memory, live.

    Figures cover the last --window seconds, at most since the start; Ctrl-C ends the command.
    """
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=WIDTH)
    with (
        open_client(connect, robot) as client,
        _snapshots(client, seconds) as snapshot,
        suppress(KeyboardInterrupt),
    ):
        if once:
            _wait(snapshot, min(seconds, FIRST_S))
        elif console.is_terminal and not json:
            with Live("listening ...", console=console, auto_refresh=False, screen=True) as live:
                while True:
                    time.sleep(every_s)
                    now = snapshot()
                    view = drawn(now) if now.processes else Text(client.found(), "yellow")
                    live.update(view, refresh=True)
        while True:
            if not once:
                time.sleep(every_s)
            if json:
                print_json(snapshot())
            else:
                console.print(drawn(snapshot()))
            if once:
                return


@contextmanager
def _snapshots(client: Client, seconds: float) -> Iterator[Callable[[], SystemSnapshot]]:
    """Listen in a thread until the block ends; yield a function that returns a snapshot."""
    monitor = Monitor(ProcessId(HERE, f"top-{os.getpid()}", socket.gethostname()), seconds)
    begin_s, ended = time.monotonic(), threading.Event()

    def snapshot() -> SystemSnapshot:
        now_s = time.monotonic()
        heard_s = min(seconds, round(now_s - begin_s, 1))
        return msgspec.structs.replace(monitor.snapshot(now_s), seconds=heard_s)

    def listen() -> None:
        for _ in monitor.follow(client):
            if ended.is_set():
                return

    threading.Thread(target=listen, name="top", daemon=True).start()
    try:
        yield snapshot
    finally:
        ended.set()


def _wait(snapshot: Callable[[], SystemSnapshot], seconds: float) -> None:
    """Listen for a period, and for twice the period if nothing arrives."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s or not snapshot().processes:
        if time.monotonic() > end_s + seconds:
            raise People4dError(
                f"no heartbeat arrived within {2 * seconds:g} s", "See what runs with people4d ps."
            )
        time.sleep(0.1)


def drawn(snapshot: SystemSnapshot) -> Group:
    """Draw a snapshot: end-to-end latency and clocks, the processes, the stages."""
    return Group(
        _headline(snapshot),
        _clocks(snapshot.clocks),
        Text(""),
        _processes(snapshot.processes),
        *(Text(f"{p.instance}: {p.reason}", "yellow") for p in snapshot.processes if p.reason),
        Text(""),
        _stages(snapshot),
    )


def _headline(snapshot: SystemSnapshot) -> Text:
    total = snapshot.end_to_end
    if total is None:
        return Text(f"no frame passed in the last {snapshot.seconds:g} s", style="yellow")
    return Text(
        f"end to end p50 {total.p50_ms:.1f}  p95 {total.p95_ms:.1f}  p99 {total.p99_ms:.1f} ms"
        f"{_error(total)} · {total.count} frames in {snapshot.seconds:g} s"
    )


def _clocks(clocks: list[ClockSnapshot]) -> Text:
    lines = []
    for clock in clocks:
        if clock.offset_ms is None or clock.error_ms is None:
            lines.append(f"{clock.host} not known")
        elif clock.error_ms == 0:
            lines.append(f"{clock.host} 0 (the router's)")
        else:
            lines.append(f"{clock.host} {clock.offset_ms:+.2f} ± {clock.error_ms:.2f} ms")
    return Text(f"clocks ahead of the router's: {' · '.join(lines) or 'no host was heard'}")


def _processes(processes: list[ProcessSnapshot]) -> Table:
    columns = ("process", "state", ">cpu%", ">MB", "in/s", ">age ms", "out/s", "losses")
    table = plain_table(*columns, no_wrap=True)
    table.columns[-1].no_wrap = False
    for process in processes:
        if not process.state:  # no heartbeat
            continue
        rates, ages = process.rates_hz, process.ages_ms
        inputs = [topic for topic in STREAMS if f"received_{topic}" in rates]
        outputs = [topic for topic in STREAMS if rates.get(f"sent_{topic}")]
        table.add_row(
            shown(process.instance),
            coloured_state(process.state),
            _number(process.cpu_percent),
            _number(process.memory_mb),
            "\n".join(f"{topic} {rates[f'received_{topic}']:.0f}" for topic in inputs),
            "\n".join(_number(ages.get(topic)) for topic in inputs),
            "\n".join(f"{topic} {rates[f'sent_{topic}']:.0f}" for topic in outputs),
            "\n".join(f"{shown(name)} {count}" for name, count in process.losses.items()),
        )
    return table


def _stages(snapshot: SystemSnapshot) -> Table:
    columns = ("stage", ">p50 ms", ">p95 ms", ">p99 ms", ">frames", "")
    table = plain_table(f"last {snapshot.seconds:g} s", *columns)
    for process in snapshot.processes:
        name = HERE if process.service == HERE else process.instance
        for stage in process.stages:
            figures = (f"{ms:.2f}" for ms in (stage.p50_ms, stage.p95_ms, stage.p99_ms))
            note = "parallel" if stage.parallel else _error(stage)
            table.add_row(shown(name), shown(stage.stage), *figures, str(stage.count), note)
            name = ""
    return table


def _error(durations: Durations) -> str:
    """Format the clock error of a duration; empty on one host."""
    if durations.error_ms is None:
        return " (clocks not compared)"
    return f" ± {durations.error_ms:.2f}" if durations.error_ms else ""


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.0f}"
