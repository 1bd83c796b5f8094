"""Attacks on a running system over its network, without keys.

After each attack no process is replaced, no exception is raised, memory has grown by less than
50 MB, and all people are tracked at their positions under the same identity. The fault is counted,
is the reason in a heartbeat, and is found by the doctor.
"""

import ast
import sys
from collections.abc import Iterator

import pytest

from tests.attacks.attacker import ATTACKS
from tests.attacks.observer import ATTACK_S, ATTACKER, Observer, attacking, begin_of, same_people
from tests.attacks.reports import REPORTS, SILENT
from tests.integration.system import running

pytestmark = [pytest.mark.processes, pytest.mark.network]

MEMORY_MB = 50.0
# On a quiet machine tracks pause for 1 s, and reports come within 3 s. Other tests run at the same
# time; the machine's own pauses are measured before each attack.
PAUSE_S, REPORTED_S, PAUSES = 10.0, 20.0, 15.0
INVENTS_PEOPLE = ("extreme_values_in_every_field",)  # all listeners receive these, too


@pytest.fixture(scope="module")
def observer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Observer]:
    source = "tests.attacks.standing:StandingPeople"
    folder = tmp_path_factory.mktemp("state")
    with running(folder, source=source) as system:
        observer = Observer(system)
        try:
            observer.begin()
            yield observer
        finally:
            observer.close()


def test_the_attacker_imports_nothing_of_the_project() -> None:
    tree = ast.parse(ATTACKER.read_text(encoding="utf-8"))
    found = {n.name for node in ast.walk(tree) if isinstance(node, ast.Import) for n in node.names}
    found |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    top = {name.partition(".")[0] for name in found}
    assert top - sys.stdlib_module_names == {"zenoh", "msgpack"}


@pytest.mark.parametrize("name", ATTACKS)
def test_attack_changes_nothing_for_people(observer: Observer, name: str) -> None:
    expected = REPORTS[name]
    before, refused = observer.begin(expected), observer.refusals()
    with attacking(observer, name) as process:
        begun_s = begin_of(process)
        if name == "a_reader_that_stops":
            observer.wait_for_people(15)
        else:
            _, errors = process.communicate(timeout=ATTACK_S)
            assert process.returncode == 0, errors.decode()
        observer.wait_for_report()
        observer.wait_for_people()
    after = observer.snapshot()
    grown = {n: after.memory_mb[n] - mb for n, mb in before.memory_mb.items()}
    assert after.pids == before.pids
    assert after.errors == before.errors
    assert same_people(before.positions_m, after.positions_m)
    if name not in INVENTS_PEOPLE:
        assert observer.identities == before.positions_m.keys()
    assert max(grown.values()) < MEMORY_MB, grown
    assert observer.longest_pause_s() < PAUSE_S + PAUSES * observer.calm_s
    late_s = {part: at_s - begun_s for part, at_s in observer.reported_s.items()}
    assert all(s < REPORTED_S + PAUSES * observer.calm_s for s in late_s.values()), late_s
    if expected.nothing:
        assert observer.refusals() == refused
        assert not SILENT & observer.discontent() - observer.discontent_before


def test_every_attack_is_reported_or_says_why_not() -> None:
    assert REPORTS.keys() == ATTACKS.keys()
    assert all(bool(report.parts) != bool(report.nothing) for report in REPORTS.values())
