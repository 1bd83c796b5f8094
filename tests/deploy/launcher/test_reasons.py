"""Reasons of processes that are reported in the terminal of people4d up."""

import pytest

from deploy.launcher import reasons
from deploy.launcher.reasons import Reasons
from people4d.messages import Health
from tests.common.diagnosis.test_checks import health

FAULT = "depth_mm is float32 (480, 640), expected uint16 (480, 640) millimetres"


@pytest.fixture
def printed(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    monkeypatch.setattr(reasons, "DELAY_S", 0.0)
    return []


def report(printed: list[tuple[str, str]], *rounds: list[Health]) -> None:
    reported = Reasons(lambda name, what: printed.append((name, what)))
    for healths in rounds:
        reported.add_heartbeats(healths)


def camera(reason: str, cpu_percent: float = 10.0) -> Health:
    gauges = {"cpu_percent": cpu_percent}
    return health("camera-1", state="degraded", reason=reason, gauges=gauges)


def test_reason_is_reported_once_though_its_numbers_change(printed: list[tuple[str, str]]) -> None:
    rates = [[camera(f"its source gives {hz} of 15.0 Hz")] for hz in (3.0, 2.9, 3.1)]
    report(printed, *rates, [camera(FAULT)])
    assert printed == [("camera-1", "its source gives 3.0 of 15.0 Hz"), ("camera-1", FAULT)]


def test_process_at_its_limit_is_named(printed: list[tuple[str, str]]) -> None:
    report(printed, [camera("slow", 99.0), health("detector-1", gauges={"cpu_percent": 60.0})])
    assert printed == [("camera-1", "slow (at its limit: camera-1 99 % of a core)")]


def test_process_that_waits_for_another_is_not_reported(printed: list[tuple[str, str]]) -> None:
    waits = health("reid-1", state="degraded", reason="no crops have come yet, for 7 s")
    report(printed, [waits, health("tracker-1")])
    assert printed == []


def test_reason_that_passes_is_not_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reasons, "DELAY_S", 60.0)
    printed: list[tuple[str, str]] = []
    report(printed, [camera(FAULT)], [camera(FAULT)])
    assert printed == []
