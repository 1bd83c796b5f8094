"""Command `people4d ps`."""

import time
from collections import Counter
from contextlib import closing

import msgspec
from rich.console import Console
from rich.table import Table

from deploy.cli.options import Connect, Json, Robot, open_client
from deploy.cli.terminal import coloured_state, plain_table, print_json, shown
from deploy.launcher.health import Heartbeats, of_instance
from deploy.launcher.state import State
from deploy.launcher.supervisor import Process, Supervisor
from people4d.errors import People4dError
from people4d.messages import Health

LISTEN_S = 1.2  # duration of two heartbeats [s]
LOSSES = ("bad_", "foreign_", "dropped", "gaps_", "errors")


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """Row of the table: one process."""

    instance: str  # name of the process
    process: str  # state in supervisord; empty for another host
    health: str  # state in its heartbeat; empty if there is no heartbeat
    reason: str  # reason of a state other than ready
    host: str  # name of the machine
    pid: int  # process number, 0 if it does not run
    uptime_s: float  # [s] time since the start; 0 if unknown
    rates_hz: dict[str, float]  # [Hz] messages received and sent, by topic
    losses: dict[str, int]  # number of lost messages and errors since the start, by cause
    cpu_percent: float  # processor time, 100 is one core
    memory_mb: float  # resident memory


def ps(robot: Robot = "robot", connect: Connect = "", json: Json = False) -> None:
    """Show processes: state, health, rates, losses.

    Without --connect: processes of people4d up on this host; with it: all with heartbeats.
    """
    state = State.of_robot(robot)
    running = state.read()
    if not (running or connect):
        raise People4dError(
            f"nothing runs here for {robot}",
            "Start it with people4d up, or name the router of a system elsewhere with --connect.",
        )
    # --connect may be the router of this host.
    own = running if running and connect in ("", running.connect) else None
    processes = Supervisor(state).processes() if own else {}
    healths = _heartbeats(connect or (running.connect if running else ""), robot, bool(own))
    own_health = {name: of_instance(healths, name) for name in processes}
    rows = [_row(name, process, own_health[name]) for name, process in processes.items()]
    rows += [_row(h.instance, None, h) for h in healths if h not in own_health.values()]
    if not rows:
        with open_client(connect, robot) as client:
            raise People4dError("no heartbeat arrives", f"{client.found()}.")
    if json:
        print_json(rows)
    else:
        console = Console()
        console.print(_table(rows))
        for row in rows:
            losses = ", ".join(f"{name} {count}" for name, count in sorted(row.losses.items()))
            for text in (row.reason, losses and f"losses since its start: {losses}"):
                if text:
                    console.print(shown(f"{row.instance}: {text}"), highlight=False)


def _heartbeats(connect: str, robot: str, optional: bool) -> list[Health]:
    """Return heartbeats; none without a router if they are optional."""
    try:
        with closing(Heartbeats(connect, robot)) as heartbeats:
            heartbeats.connect(timeout_s=2.0)
            deadline_s = time.monotonic() + LISTEN_S
            while (left_s := deadline_s - time.monotonic()) > 0:
                heartbeats.wait(left_s)
            return sorted(heartbeats.all(), key=lambda health: (health.instance, health.host))
    except People4dError:
        if optional:
            return []
        raise


def _row(name: str, process: Process | None, health: Health | None) -> Row:
    gauges = health.gauges if health else {}
    counters = health.counters if health else {}
    return Row(
        instance=name,
        process=process.state if process else "",
        health=health.state if health else "",
        reason=(health.reason if health else "") or (process.problem if process else ""),
        host=health.host if health else "",
        pid=process.pid if process else health.pid if health else 0,
        uptime_s=process.uptime_s if process else 0.0,
        rates_hz={n.removesuffix("_hz"): v for n, v in gauges.items() if n.endswith("_hz")},
        losses={n: v for n, v in counters.items() if n.startswith(LOSSES) and v},
        cpu_percent=gauges.get("cpu_percent", 0.0),
        memory_mb=gauges.get("memory_mb", 0.0),
    )


def _table(rows: list[Row]) -> Table:
    columns = ("process", "state", ">pid", ">up", ">cpu%", ">MB", "in/s", "out/s")
    table = plain_table(*columns, no_wrap=True)
    count = Counter(row.instance for row in rows)
    for row in rows:
        # State in supervisord unless the process runs, else the state in its heartbeat.
        state = row.process.lower() if row.process not in ("", "RUNNING") else row.health
        table.add_row(
            shown(row.instance if count[row.instance] == 1 else f"{row.instance} ({row.host})"),
            coloured_state(state or "silent"),
            str(row.pid or ""),
            duration(row.uptime_s) if row.uptime_s else "",
            f"{row.cpu_percent:.0f}",
            f"{row.memory_mb:.0f}",
            _rates(row.rates_hz, "received_"),
            _rates(row.rates_hz, "sent_"),
        )
    return table


def _rates(rates_hz: dict[str, float], direction: str) -> str:
    return "\n".join(
        f"{name.removeprefix(direction)} {rate:.0f}"
        for name, rate in sorted(rates_hz.items())
        if name.startswith(direction) and rate >= 0.5
    )


def duration(seconds: float) -> str:
    """Format a time as 12s, 3m05s or 2h03m."""
    minutes, seconds = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours}h{minutes:02}m"
    return f"{minutes}m{seconds:02}s" if minutes else f"{seconds}s"
