"""Launch of a system from the terminal: start, supervision and summary."""

import time
from contextlib import ExitStack, closing
from pathlib import Path

import msgspec
import typer

from deploy.cli.live.page import page_address
from deploy.cli.terminal import console, print_progress, signals_interrupt
from deploy.launcher.health import Heartbeats
from deploy.launcher.launcher import Launcher, LaunchError, check_stopped, stop
from deploy.launcher.plan import CAMERA, REPORT, LaunchRequest, check_settings, plan, router_of
from deploy.launcher.state import State
from deploy.launcher.supervisor import SupervisorGoneError
from people4d.errors import People4dError

# Lock-step waits for every result, so a recording gives the same tracks on any machine.
LOCKSTEP_WAITS = ("tracker.embedding_wait_s=4.0", "tracker.reorder_wait_s=4.0")
SIMULATED = (
    "The room, the people and their depth images are simulated, with exact ground truth. "
    "Detection, tracking and all times are real."
)
TOO_SLOW = "too slow: "  # part of the reason of a service that skips frames
LIMITED = 3  # exit code of a complete report with degraded services
DRAIN_TIMEOUT_S = 120.0
GONE_TIMEOUT_S = 3.0
POLL_S = 0.5
START_TIMEOUT_S = 60.0


def launch(request: LaunchRequest, timeout_s: float, detach: bool) -> None:
    """Start a system; unless detached, supervise it until it stops or its source ends."""
    state = State.of_robot(request.robot)
    check_stopped(state, request.robot)  # before the check of the settings, which takes seconds
    services = plan(request)
    check_settings(services, request)
    connect = router_of(services, request)
    with signals_interrupt(), closing(Heartbeats(connect, request.robot)) as heartbeats:
        launcher = Launcher(state, services, heartbeats, print_progress)
        try:
            launcher.start(request.robot, connect, timeout_s)
            _print_page(state)
            if detach:
                console.print(f"{launcher.summary()}. See: people4d ps, listen, logs, down")
                return
            _attend_to_end(launcher, request)
        except KeyboardInterrupt:
            console.print("Stopped.")
            raise typer.Exit(130 if request.report else 0) from None
    if request.report:
        _print_summary(request.report, state)


def _print_page(state: State) -> None:
    address = page_address(state)
    if address:
        console.print(f"Page in the browser: {address.login}", markup=False)


def _attend_to_end(launcher: Launcher, request: LaunchRequest) -> None:
    """Supervise a system, and stop it at the end; People4dError if a process failed."""
    state = launcher.state
    with ExitStack() as end:
        end.callback(stop, state)
        if request.report:
            end.callback(console.print, "Writing the report ...")
        try:
            _attend(launcher, request)
        except SupervisorGoneError as error:
            if not state.was_stopped(GONE_TIMEOUT_S):
                end.pop_all()
                raise People4dError(
                    "supervisord was killed: the services run on, but none is restarted",
                    "End them with people4d down, or restart with people4d up.",
                ) from error
            console.print("Stopped by people4d down.")


def _attend(launcher: Launcher, request: LaunchRequest) -> None:
    if request.report:
        console.print("Running to the end of the source ...")
        launcher.wait_finished(CAMERA)
        launcher.drain(DRAIN_TIMEOUT_S)
        return
    console.print(f"{launcher.summary()}; Ctrl-C stops it. In another terminal: people4d listen")
    while True:
        launcher.processes()
        time.sleep(POLL_S)


def _print_summary(folder: Path, state: State) -> None:
    from services.report.statistics import RunSummary  # noqa: PLC0415 (loads SciPy)

    summary = folder / "summary.txt"
    if not (folder / "summary.json").is_file():  # written last
        raise LaunchError(state, f"{REPORT}-1", f"the report in {folder} is not complete")
    facts = summary.read_text(encoding="utf-8").partition("\n\n")[0]
    console.print(facts, markup=False)  # the report has the table of latency
    summary_json = msgspec.json.decode((folder / "summary.json").read_bytes(), type=RunSummary)
    names = sorted(file.name for file in folder.iterdir() if file.suffix != ".part")
    console.print(f"\nReport: {folder}/ ({', '.join(names)})", markup=False)
    if summary_json.degraded:
        console.print("The run had limits: see degraded above.", style="yellow")
        if any(TOO_SLOW in reason for reason in summary_json.degraded):
            console.print("--playback lockstep takes every frame, however long that takes.")
        raise typer.Exit(LIMITED)
