"""Processes that hang, by their heartbeats, and how often they are restarted."""

import dataclasses

import pytest

from deploy.launcher.hangs import HangDetector, WatchdogConfig
from deploy.launcher.supervisor import Process, Supervisor, SupervisorGoneError
from deploy.launcher.watchdog import ROOM_BYTES, WatchdogNode
from people4d.messages import Health
from people4d.messages.status import State
from tests import builders

CONFIG = WatchdogConfig(
    silent_s=4.0, stalled_s=8.0, start_s=60.0, restarts_max=2, restarts_window_s=100.0
)
S = 10**9
PID = 2**22 + 1  # above all that the kernel gives


def health(name: str, pid: int = PID, state: State = "ready", host: str = "here") -> Health:
    service = name.partition("-")[0]
    return builders.health(service, instance=name, host=host, pid=pid, state=state)


def process(name: str, pid: int = PID, state: str = "RUNNING", uptime_s: float = 99.0) -> Process:
    return Process(name, state, pid, uptime_s, 0, "")


class Machine:
    """Processes and their heartbeats, twice a second; processes in `hanging` send none."""

    def __init__(self, *names: str) -> None:
        self.watch = HangDetector(CONFIG)
        self.processes = {name: process(name) for name in names}
        self.states: dict[str, State] = dict.fromkeys(names, "ready")
        self.hanging: set[str] = set()
        self.now_s = 1000.0

    def run(self, seconds: float) -> dict[str, str]:
        """Let time pass; return the processes that hang at its end."""
        found: dict[str, str] = {}
        for _ in range(int(2 * seconds)):
            self.now_s += 0.5
            for name, state in self.states.items():
                if name not in self.hanging:
                    self.watch.add_heartbeat(
                        health(name, self.processes[name].pid, state), self.now_s
                    )
            found = self.watch.hung(self.processes, self.now_s)
        return found


@pytest.fixture
def machine() -> Machine:
    machine = Machine("router-1", "detector-1", "tracker-1")
    assert machine.run(5) == {}
    return machine


def test_process_without_heartbeat_hangs_after_4_s(machine: Machine) -> None:
    machine.hanging.add("tracker-1")
    assert machine.run(4) == {}
    assert machine.run(0.5) == {"tracker-1": "no heartbeat for 4 s"}


def test_stalled_process_hangs_after_8_s(machine: Machine) -> None:
    machine.states["detector-1"] = "stalled"
    assert machine.run(8.5) == {}
    assert machine.run(0.5) == {"detector-1": "stalled for 8 s"}


def test_forged_heartbeats_of_another_process_number_change_nothing(machine: Machine) -> None:
    for number in range(200):
        for state in ("stalled", "stopping", "ready"):
            machine.watch.add_heartbeat(health("tracker-1", 7000 + number, state), machine.now_s)
        machine.watch.add_heartbeat(health(f"invented-{number}"), machine.now_s)
        assert machine.run(0.5) == {}
    assert len(machine.watch._heard) < 50
    assert machine.watch.unannounced == 200  # each invented process appears once
    machine.hanging.add("tracker-1")  # nor do they hide a hung process
    for number in range(10):
        machine.watch.add_heartbeat(health("tracker-1", 7000 + number), machine.now_s)
        found = machine.run(0.5)
    assert list(found) == ["tracker-1"]


def test_process_that_stalls_at_times_does_not_hang(machine: Machine) -> None:
    for _ in range(5):
        machine.states["detector-1"] = "stalled"
        assert machine.run(7) == {}
        machine.states["detector-1"] = "ready"
        assert machine.run(0.5) == {}


def test_restarted_process_hangs_after_60_s(machine: Machine) -> None:
    machine.hanging.add("detector-1")
    machine.processes["detector-1"] = process("detector-1", pid=2, uptime_s=59.0)
    assert machine.run(30) == {}
    machine.processes["detector-1"] = process("detector-1", pid=2, uptime_s=61.0)
    assert machine.run(0.5) == {"detector-1": "no heartbeat within 60 s of its start"}


def test_process_that_never_sent_a_heartbeat_is_ignored(machine: Machine) -> None:
    machine.processes["mine-1"] = process("mine-1")
    assert machine.run(100) == {}


def test_process_that_does_not_run_is_ignored(machine: Machine) -> None:
    machine.hanging.add("tracker-1")
    for state in ("STOPPING", "BACKOFF", "EXITED", "STARTING"):
        machine.processes["tracker-1"] = process("tracker-1", state=state)
        assert machine.run(10) == {}


def test_stopping_process_does_not_hang(machine: Machine) -> None:
    machine.states["tracker-1"] = "stopping"
    machine.run(1)
    machine.hanging.add("tracker-1")
    assert machine.run(30) == {}


def test_silence_of_all_processes_is_the_routers_fault(machine: Machine) -> None:
    machine.hanging |= {"router-1", "detector-1", "tracker-1"}
    assert list(machine.run(10)) == ["router-1"]


def test_time_while_the_watchdog_did_not_run_is_not_counted(machine: Machine) -> None:
    machine.now_s += 600.0  # the machine slept
    assert machine.watch.hung(machine.processes, machine.now_s) == {}
    machine.hanging.add("tracker-1")
    assert machine.run(2) == {}
    assert list(machine.run(2.5)) == ["tracker-1"]


class Supervised(Supervisor):
    """Processes that restart with another number after they are killed."""

    def __init__(self, *names: str) -> None:
        self.all = {name: process(name) for name in names}
        self.killed: list[str] = []
        self.traced: list[bool] = []
        self.gone = False

    def processes(self) -> dict[str, Process]:
        if self.gone:
            raise SupervisorGoneError("supervisord does not answer")
        return self.all

    def kill(self, instance: str, trace: bool = True) -> None:
        self.killed.append(instance)
        self.traced.append(trace)
        before = self.all[instance]
        self.all[instance] = dataclasses.replace(before, pid=before.pid + 1, uptime_s=0.0)


def run(node: WatchdogNode, start_s: int, end_s: int, *heard: Health) -> None:
    for half in range(2 * start_s, 2 * end_s):
        now_ns = half * S // 2
        for message in heard:
            node.handle(message, now_ns)
        node.tick(now_ns)


def test_hung_process_is_killed_once_and_reported() -> None:
    supervised = Supervised("router-1", "tracker-1")
    node = WatchdogNode(CONFIG, supervised, "here")
    run(node, 0, 2, health("router-1"), health("tracker-1"))
    run(node, 2, 20, health("router-1"))
    assert supervised.killed == ["tracker-1"]
    status = node.status()
    assert (status.state, status.counters["restarts"]) == ("ready", 1)
    assert status.reason == "tracker-1 hung (no heartbeat for 4 s) and was started again"
    run(node, 20, 90, health("router-1"), health("tracker-1", pid=2))
    assert node.status().reason == ""


def test_full_disk_is_reported_until_there_is_room() -> None:
    free = [ROOM_BYTES - 1]
    node = WatchdogNode(CONFIG, Supervised("router-1"), "here", lambda: free[0])
    assert node.status().state == "degraded"
    assert "the disk of the state folder is full" in node.status().reason
    free[0] = ROOM_BYTES
    assert node.status().state == "ready"


def test_process_that_hangs_repeatedly_is_left_and_reported() -> None:
    supervised = Supervised("router-1", "tracker-1")
    node = WatchdogNode(CONFIG, supervised, "here")
    for number in range(1, 4):
        begin_s, pid = 10 * number, PID + number - 1
        run(node, begin_s, begin_s + 1, health("router-1"), health("tracker-1", pid=pid))
        run(node, begin_s + 1, begin_s + 10, health("router-1"))
    assert supervised.killed == ["tracker-1"] * 2
    status = node.status()
    assert status.state == "degraded"
    assert status.reason.startswith("tracker-1 hung 2 times in 100 s and is left alone now")


def test_killed_process_is_not_killed_twice_before_supervisord_notices() -> None:
    class Slow(Supervised):
        def kill(self, instance: str, trace: bool = True) -> None:
            self.killed.append(instance)

    supervised = Slow("router-1", "tracker-1")
    node = WatchdogNode(CONFIG, supervised, "here")
    run(node, 0, 2, health("router-1"), health("tracker-1"))
    run(node, 2, 10, health("router-1"))
    assert supervised.killed == ["tracker-1"]


def test_hung_processes_are_restarted_one_after_the_other_in_growing_intervals() -> None:
    names = ["router-1", "camera-1", "detector-1", "reid-1", "tracker-1"]
    supervised = Supervised(*names)
    node = WatchdogNode(CONFIG, supervised, "here")
    run(node, 0, 2, *map(health, names))
    run(node, 2, 7, health("router-1"))
    assert len(supervised.killed) == 1
    run(node, 7, 11, health("router-1"))
    assert len(supervised.killed) == 2
    run(node, 11, 18, health("router-1"))
    assert len(supervised.killed) == 3
    run(node, 18, 60, health("router-1"))
    assert len(supervised.killed) == 4
    assert "router-1" not in supervised.killed


@pytest.mark.parametrize(("hung_s", "calm_s"), [(6, 6), (5, 1)], ids=["calm", "no calm"])
def test_processes_that_hang_one_at_a_time_are_restarted_at_once(hung_s: int, calm_s: int) -> None:
    names = ["router-1", "camera-1", "detector-1", "reid-1", "tracker-1", "gait-1"]
    supervised = Supervised(*names)
    node = WatchdogNode(CONFIG, supervised, "here")
    run(node, 0, 2, *map(health, names))
    for number, hung in enumerate(names[1:]):
        begin_s = 2 + (hung_s + calm_s) * number
        back_s, end_s = begin_s + hung_s, begin_s + hung_s + calm_s
        others = [health(name, p.pid) for name, p in supervised.all.items() if name != hung]
        run(node, begin_s, back_s, *others)
        assert supervised.killed == names[1 : number + 2]
        run(node, back_s, end_s, *others, health(hung, supervised.all[hung].pid))


def test_process_that_was_not_heard_of_is_not_asked_for_a_trace() -> None:
    supervised = Supervised("router-1", "tracker-1")
    node = WatchdogNode(CONFIG, supervised, "here")
    run(node, 0, 2, health("router-1"), health("tracker-1"))
    supervised.all["tracker-1"] = process("tracker-1", pid=2, uptime_s=99.0)
    run(node, 2, 4, health("router-1"))
    assert (supervised.killed, supervised.traced) == (["tracker-1"], [False])


def test_late_watchdog_reads_what_waits_before_it_judges() -> None:
    supervised = Supervised("router-1", "tracker-1")
    node = WatchdogNode(CONFIG, supervised, "here")
    run(node, 0, 2, health("router-1"), health("tracker-1"))
    for half, name in enumerate(("router-1", "tracker-1")):  # both sent on time, and wait
        node.handle(health(name), 10 * S + half)
        node.tick(10 * S + half)
    assert supervised.killed == []


def test_processes_of_other_hosts_are_ignored() -> None:
    supervised = Supervised("router-1", "tracker-1")
    node = WatchdogNode(CONFIG, supervised, "here")
    run(node, 0, 2, health("router-1"), health("tracker-1", pid=1, host="elsewhere"))
    run(node, 2, 20, health("router-1"))
    assert supervised.killed == []


def test_absent_supervisord_is_reported_and_the_watchdog_continues() -> None:
    supervised = Supervised("router-1", "tracker-1")
    node = WatchdogNode(CONFIG, supervised, "here")
    supervised.gone = True
    run(node, 0, 2, health("router-1"))
    assert node.status().reason == "supervisord does not answer"
    supervised.gone = False
    run(node, 2, 4, health("router-1"))
    assert node.status().state == "ready"


def test_bad_settings_are_rejected() -> None:
    with pytest.raises(ValueError, match="silent_s: expected a finite number > 0, got 0"):
        WatchdogConfig(silent_s=0.0)
