"""Threads and cores of networks: their cores and their order."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from onnx import TensorProto

from common.inference.cores import VARIABLE, InferenceCores, NetworkRuns, read_cores
from common.transport.trace import ProcessId, collect
from people4d.errors import ConfigError
from tests.common.test_inference import doubling

if not hasattr(os, "sched_setaffinity"):
    pytest.skip("needs Linux", allow_module_level=True)
ALLOWED = os.sched_getaffinity(0)
two_cores = pytest.mark.skipif(len(ALLOWED) < 2, reason="needs two cores")


def in_thread(cores: InferenceCores, environment: dict[str, str]) -> list[set[int]]:
    """Return the cores of a thread after reserving, of a network run, and of the thread then."""
    found: list[set[int]] = []

    def reserve() -> None:
        cores.reserve(environment)
        found.append(os.sched_getaffinity(0))
        found.append(NetworkRuns(cores).call(lambda: os.sched_getaffinity(0)))
        found.append(os.sched_getaffinity(0))

    thread = threading.Thread(target=reserve)  # the affinity of the test's own thread stays
    thread.start()
    thread.join()
    return found


@pytest.mark.parametrize(
    ("text", "expected"),
    [("1", {1}), ("0,2", {0, 2}), ("2-4", {2, 3, 4}), ("0-1,5", {0, 1, 5}), (" 1 , 2", {1, 2})],
)
def test_lists_of_cores_are_read(text: str, expected: set[int]) -> None:
    assert read_cores(text) == expected


@pytest.mark.parametrize("text", ["a", "1,", "3-2", "-1", "1-", "1.5", "99999", "0-4000000000"])
def test_lists_of_no_cores_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=VARIABLE):
        read_cores(text)


@pytest.mark.parametrize("text", [",".join(map(str, ALLOWED)), "4000", f"{min(ALLOWED)},4000"])
def test_all_cores_and_absent_ones_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="must name some, not all, of the cores"):
        InferenceCores().reserve({VARIABLE: text})


@pytest.mark.parametrize("environment", [{}, {VARIABLE: ""}])
def test_without_a_reservation_threads_use_all_cores(environment: dict[str, str]) -> None:
    assert in_thread(InferenceCores(), environment) == [ALLOWED] * 3


@two_cores
def test_networks_have_their_cores_and_all_else_the_others() -> None:
    core = max(ALLOWED)
    others = ALLOWED - {core}
    assert in_thread(InferenceCores(), {VARIABLE: str(core)}) == [others, {core}, others]


@two_cores
def test_a_failed_run_raises_as_without_a_reservation() -> None:
    def fail() -> None:
        raise ValueError("of the network")

    cores = InferenceCores()
    assert in_thread(cores, {VARIABLE: str(max(ALLOWED))})
    runs = NetworkRuns(cores)
    with pytest.raises(ValueError, match="of the network"):
        runs.run(fail)
    assert runs.run(lambda: 1) == 1


@pytest.mark.parametrize("cores", [None, InferenceCores()])
def test_a_network_runs_in_one_thread_or_in_those_of_its_callers(
    cores: InferenceCores | None,
) -> None:
    runs, callers = NetworkRuns(cores), list[int]()
    threads = set[int]()

    def call() -> None:
        callers.append(threading.get_ident())
        threads.add(runs.run(threading.get_ident))

    started = [threading.Thread(target=call) for _ in range(3)]
    for thread in started:
        thread.start()
    for thread in started:
        thread.join()
    if cores is None:
        assert threads == set(callers)
    else:
        assert len(threads) == 1
        assert not threads.intersection(callers)


@pytest.mark.parametrize("cores", [None, InferenceCores()])
def test_one_run_at_a_time_and_the_wait_for_it_is_recorded(cores: InferenceCores | None) -> None:
    runs, entered, end = NetworkRuns(cores), threading.Event(), threading.Event()

    def first() -> None:
        entered.set()
        end.wait(10)

    thread = threading.Thread(target=lambda: runs.run(first))
    thread.start()
    entered.wait(10)
    timer = threading.Timer(0.05, end.set)
    timer.start()
    with collect(ProcessId("detector", "detector", "here")) as spans:
        runs.run(lambda: time.sleep(0.01))
    thread.join()
    waited, ran, *after = spans
    assert (waited.stage, ran.stage) == ("detector.inference_wait", "detector.inference")
    assert waited.end_ns - waited.start_ns > 0.03e9
    assert ran.start_ns == waited.end_ns
    assert ran.end_ns - ran.start_ns >= 0.01e9
    # A thread of its own ends, and the caller continues later.
    assert [one.stage for one in after] == (["detector.wake"] if cores else [])
    assert all(one.start_ns == ran.end_ns for one in after)


@two_cores
def test_a_system_that_binds_no_threads_is_reported(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setaffinity", refuse)
    assert in_thread(InferenceCores(), {VARIABLE: str(max(ALLOWED))}) == [ALLOWED] * 3
    assert caplog.text.count("cannot be bound to the cores") == 2


@two_cores
@pytest.mark.processes
def test_threads_of_a_network_inherit_its_cores(tmp_path: Path) -> None:
    path = doubling(tmp_path / "m.onnx", TensorProto.FLOAT, [1, "n", 2])
    core = max(ALLOWED)
    script = f"""
import os
from pathlib import Path
from common.inference.cores import DETECTOR
DETECTOR.reserve({{"{VARIABLE}": "{core}"}})
import onnxruntime
before = set(os.listdir("/proc/self/task"))
from common.inference.onnx import OnnxSession
session = OnnxSession(Path({str(path)!r}), threads=2, cores=DETECTOR)
made = set(os.listdir("/proc/self/task")) - before
print(len(made), *(os.sched_getaffinity(int(task)) for task in made))
"""
    found = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    # The thread of the runs, and the second requested thread.
    assert found.stdout.strip() == f"2 {{{core}}} {{{core}}}"


@pytest.mark.processes
def test_a_service_refuses_cores_that_the_computer_does_not_have() -> None:
    found = subprocess.run(
        [sys.executable, "-m", "services.detector"],
        env={**os.environ, VARIABLE: "4000"},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert found.returncode == 1
    assert VARIABLE in found.stderr
    assert "Traceback" not in found.stderr
