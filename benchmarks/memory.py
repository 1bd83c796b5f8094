"""Memory of the default system, and time until it works, with services forked and executed.

Proportional set size of every process after some seconds of work: memory that processes share
counts for each by its part. Live: a camera at 15 Hz before which three people stand. Recording: the
shipped one, whose depth camera is simulated while it plays. Executed: each service as a Python of
its own (`PEOPLE4D_PREFORK=off`). Forked: from a process that has loaded what services share.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

from benchmarks.lib.table import markdown, spread, write
from common.transport.ports import free_port
from deploy.cli.system.demo import DEMO
from deploy.launcher.launcher import stop
from deploy.launcher.state import State
from deploy.launcher.supervisor import Supervisor

ROBOT = "memory"
ROOT = Path(__file__).resolve().parents[1]
SOURCES = {"live": "benchmarks.lib.system.standing:Standing", "recording": str(DEMO)}
STARTS = {"executed": "off", "forked": "on"}
FORMS = {"`up --detach` [s]": "{:.1f}"}
SUPERVISORD, TOTAL, READY = "supervisord", "all", "`up --detach` [s]"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=20.0, help="of work before the look")
    options = parser.parse_args()
    found: dict[tuple[str, str], list[dict[str, float]]] = {}
    for number in range(options.rounds):
        for source in SOURCES:
            for start in STARTS:
                print(f"round {number + 1} of {options.rounds}: {source}, {start}", flush=True)
                found.setdefault((source, start), []).append(
                    measure(source, start, options.seconds)
                )
    columns = [(source, start) for source in SOURCES for start in STARTS]
    names = list(found[columns[0]][0])
    rows = [
        [
            name,
            *(
                spread([one[name] for one in found[start]], FORMS.get(name, "{:.0f}"))
                for start in columns
            ),
        ]
        for name in names
    ]
    header = ("process [MB]", *(f"{source}, {start}" for source, start in columns))
    text = (__doc__ or "").partition("\n\n")[2].strip()
    note = f"Medians with minimum and maximum of {options.rounds} rounds."
    write(__file__, "Memory of the default system", text, note, markdown(header, rows))


def measure(source: str, start: str, seconds: float) -> dict[str, float]:
    """Start the system once; return the memory of its processes [MB], and the time of `up` [s]."""
    with tempfile.TemporaryDirectory(prefix="p4d") as folder:
        state = State(Path(folder) / ROBOT)
        command = [sys.executable, "-m", "deploy.cli", "up", "--detach", "--robot", ROBOT]
        command += ["--port", str(free_port()), "--source", SOURCES[source], "--loop"]
        own = {"PEOPLE4D_STATE": folder, "PYTHONPATH": str(ROOT), "PEOPLE4D_PREFORK": STARTS[start]}
        begin_s = time.monotonic()
        subprocess.run(
            command, env={**os.environ, **own}, check=True, cwd=ROOT, stdout=subprocess.DEVNULL
        )
        ready_s = time.monotonic() - begin_s
        try:
            time.sleep(seconds)
            pids = {p.name: p.pid for p in Supervisor(state).processes().values()}
            run = state.read()
            if run is None:
                raise RuntimeError("the system ended")
            shares = {
                name: psutil.Process(pid).memory_full_info().pss / 1e6
                for name, pid in {**pids, SUPERVISORD: run.pid}.items()
            }
        finally:
            stop(state)
    return {**shares, TOTAL: sum(shares.values()), READY: ready_s}


if __name__ == "__main__":
    main()
