"""Limits of a run in the report: degraded services, early end of truth, unused inputs."""

import msgspec
import numpy as np
import pytest

from common.drawing.topdown import Trajectories
from common.geometry.transforms import LINK_FROM_OPTICAL
from common.runtime.synchroniser import SynchronisedFrame
from people4d.messages import Health, Message
from services.report.limits import MIN_BEATS, RunLimits
from services.report.page import RunPage
from services.report.series import RunSeries
from services.report.statistics import RunStatistics
from services.report.text import headline, text
from tests import builders
from tests.report.builders import frame, pose, span, track, tracks, truth

S = 10**9
NO_TRANSFORM = "no transform map <- optical: the camera is taken as the origin"


def degraded(reason: str) -> Health:
    return builders.health("tracker", state="degraded", reason=reason)


def limits_of(*messages: Message, is_scored: bool = True) -> tuple[str, ...]:
    limits = RunLimits()
    for message in messages:
        limits.add_message(message, 0)
    return limits.degraded(is_scored)


def test_reason_of_a_degraded_service_is_a_limit_once_with_its_last_numbers() -> None:
    rates = [f"{NO_TRANSFORM}; too slow: of {k} frames a second 1 are skipped" for k in range(9)]
    assert limits_of(frame(0), *map(degraded, rates)) == (
        f"tracker-1: {NO_TRANSFORM}",
        "tracker-1: too slow: of 8 frames a second 1 are skipped",
    )


def test_reason_that_passes_or_waits_is_no_limit() -> None:
    passing = [degraded(NO_TRANSFORM)] * (MIN_BEATS - 1)
    waiting = [degraded("no crops have come yet, for 7 s")] * 9
    assert limits_of(frame(0), *passing, *waiting) == ()


def test_reason_before_the_first_frame_is_no_limit() -> None:
    assert limits_of(*[degraded(NO_TRANSFORM)] * 9, frame(0)) == ()


def test_truth_that_ends_early_is_a_limit() -> None:
    early, late = truth(1 * S, ("a", 1, 0)), truth(5 * S, ("a", 1, 0))
    assert limits_of(frame(5 * S), early) == ("truth: ended 4.0 s before the frames",)
    assert limits_of(frame(5 * S), early, late) == ()
    assert limits_of(frame(5 * S), late, is_scored=False) == (
        "truth: does not cover the time of the frames",
    )


def test_truth_that_was_asked_for_and_never_comes_is_a_limit() -> None:
    limits = RunLimits("walk.csv")
    limits.add_message(frame(5 * S), 0)
    assert limits.degraded(is_scored=False) == ("truth: none arrived from walk.csv",)
    assert "truth (none received)" in limits.unused()
    limits.add_message(truth(5 * S, ("a", 1, 0)), 0)
    assert limits.degraded(is_scored=True) == ()


@pytest.mark.parametrize(
    ("messages", "unused"),
    [
        ((), ("odometry (none received", "mount (none given", "truth (none received")),
        ((pose(), truth(0, ("a", 1, 0))), ("odometry (none received",)),
        ((pose(), truth(0, ("a", 1, 0)), builders.odometry()), ("odometry (the tracker takes no",)),
    ],
)
def test_what_was_not_used_is_listed(
    messages: tuple[Message, ...], unused: tuple[str, ...]
) -> None:
    limits = RunLimits()
    limits.add_message(builders.static_transform(np.asarray(LINK_FROM_OPTICAL)), 0)
    for message in messages:
        limits.add_message(message, 0)
    found = limits.unused()
    assert len(found) == len(unused)
    assert all(a.startswith(b) for a, b in zip(found, unused, strict=True))


def test_limits_are_in_the_text_and_on_the_page() -> None:
    statistics = RunStatistics()
    for message in (frame(0), *[degraded(NO_TRANSFORM)] * MIN_BEATS):
        statistics.add_message(message, 0)
    summary = statistics.summary()
    assert f"degraded   tracker-1: {NO_TRANSFORM}" in text(summary)
    assert "not used   odometry (none received" in text(summary)
    page = RunPage(summary=summary, trajectories=Trajectories(), series=RunSeries())
    assert "tracker-1: no transform map &lt;- optical" in page.html()


def test_latency_in_lockstep_is_no_headline() -> None:
    # In lock-step frames wait for one another: 147 ms, where a live camera has 7 ms.
    statistics = RunStatistics()
    statistics.add_message(msgspec.structs.replace(frame(0), lockstep=True), 0)
    assert statistics.summary().lockstep
    statistics.settle(joined_frame())
    assert statistics.summary().latency
    assert "latency" not in headline(statistics.summary())
    assert "latency    median" not in text(statistics.summary())


def test_latency_at_the_recorded_rate_is_a_key_figure() -> None:
    statistics = RunStatistics()
    statistics.add_message(frame(0), 0)
    statistics.settle(joined_frame())
    summary = statistics.summary()
    assert headline(summary).endswith("latency 4 ms")
    assert "latency    median 4.0 ms, p95 4.0 ms, end to end\n" in text(summary)
    page = RunPage(summary=summary, trajectories=Trajectories(), series=RunSeries())
    assert "<dt>latency</dt><dd>4 <small>ms, p99 4</small></dd>" in page.html()


def joined_frame() -> SynchronisedFrame:
    trace = (span("camera.read", 0, 4),)
    return SynchronisedFrame("front", 0, frame(0), tracks=tracks(0, [track(1, 1.0)], trace=trace))
