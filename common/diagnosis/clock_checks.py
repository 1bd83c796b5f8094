"""Checks of the clocks of hosts and cameras."""

import re
from collections.abc import Iterator, Mapping

from common.diagnosis.evidence import Diagnostic, Evidence, Vitals, ok, problem, warning

CAMERA_OFFSET = re.compile(r"camera_offset_(.+)_ms")
CAMERA_DELAY = re.compile(r"camera_delay_(.+)_ms")
DELAYED_MS = 150.0  # maximum delay of a camera's messages behind another camera's [ms]
APART_NS = 50_000_000  # maximum difference of two clocks [ns]
LATE_NS = 1_000_000_000  # maximum transport time of a heartbeat [ns]
# Stamps to compare with a clock: service, maximum difference [s], check, stamps, clock, hint
STAMPS = (
    (
        *("camera", 60.0, "clocks", "stamps of {}", "its host"),
        "Give nanoseconds since 1970 (UTC) by the clock of the host, time.time_ns().",
    ),
    (
        *("ros2_bridge", 1.0, "ros2", "stamps sent to ROS 2", "this machine's clock"),
        "Nodes drop such messages: --set ros2_bridge.stamps=sent for a recording, or publish clock "
        "and set use_sim_time.",
    ),
)


def clocks(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that the clocks of hosts and cameras agree, and had no steps."""
    processes = evidence.vitals.values()
    behind_ms = {v.last.host: ns / 1e6 for v in processes if (ns := _behind_ns(v))}
    stepped = sorted(name for name, v in evidence.vitals.items() if v.since("clock_steps"))
    jumps = sum(v.total("stamp_jumps", "clock_resets") for v in processes)
    cameras = list(_camera_clocks(evidence))
    if behind_ms:
        hint = "Let all hosts keep time by one server: chrony or systemd-timesyncd."
        yield problem("clocks", f"host clocks differ: {_listing(behind_ms)}", hint)
    if stepped:
        what = f"a clock was set while {', '.join(stepped)} ran"
        yield problem(
            "clocks", what, "Adjust the clock gradually with chrony; do not set it with date."
        )
    yield from cameras
    if not (behind_ms or stepped or cameras) and jumps:
        what = f"stamps of frames jumped {jumps} times since the start: people got new numbers"
        hint = "Expected when a recording loops; with a live camera, check the clock of its host."
        yield warning("clocks", what, hint)
    elif processes and not (behind_ms or stepped or cameras):
        yield ok("clocks", "all clocks agree")


def stamps(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that stamps are near the clock of the host."""
    for service, max_s, check, what, clock, hint in STAMPS:
        for vitals in evidence.of_service(service):
            behind_s = vitals.last.gauges.get("stamps_behind_s", 0.0)
            if abs(behind_s) > max_s:
                where = f"{abs(behind_s):.0f} s {'behind' if behind_s > 0 else 'ahead of'} {clock}"
                yield warning(check, f"{what.format(vitals.last.instance)} are {where}", hint)


def _camera_clocks(evidence: Evidence) -> Iterator[Diagnostic]:
    """Report cameras with stamps of another clock."""
    for vitals in evidence.of_service("tracker"):
        gauges = vitals.last.gauges
        found = ((CAMERA_OFFSET.fullmatch(gauge), ms) for gauge, ms in gauges.items())
        behind_ms = {m[1]: -ms for m, ms in found if m and abs(ms) > APART_NS / 1e6}
        delays = ((CAMERA_DELAY.fullmatch(gauge), ms) for gauge, ms in gauges.items())
        late_ms = {m[1]: ms for m, ms in delays if m}
        if behind_ms:
            what = f"camera stamps differ, and are corrected: {_listing(behind_ms)}"
            hint = "Let their hosts keep time by one server: chrony or systemd-timesyncd."
            yield warning("clocks", what, hint)
        # Delay of the camera with the earliest messages
        first_ms = min(late_ms.values(), default=0.0)
        late = {c: ms - first_ms for c, ms in late_ms.items() if ms - first_ms > DELAYED_MS}
        if late:
            listing = ", ".join(f"{c} by {ms:.0f} ms" for c, ms in sorted(late.items()))
            what = f"messages of cameras arrive late: {listing}"
            hint = "People are tracked at the right times, but later: see the links of these hosts."
            yield warning("clocks", what, hint)


def _listing(behind_ms: Mapping[str, float]) -> str:
    return ", ".join(
        f"{name} is {abs(ms):.0f} ms {'behind' if ms > 0 else 'ahead'}"
        for name, ms in sorted(behind_ms.items())
    )


def _behind_ns(vitals: Vitals) -> float:
    """Return the minimum error of a host's clock, 0 if it is within bounds."""
    gauges = vitals.last.gauges
    if "clock_offset_ms" in gauges:
        ahead_ns, error_ns = gauges["clock_offset_ms"] * 1e6, gauges["clock_error_ms"] * 1e6
        return -ahead_ns if abs(ahead_ns) - error_ns > APART_NS else 0.0
    # If there is no reference: a heartbeat cannot arrive before it was sent, or much later.
    late_ns = vitals.late_ns
    return float(late_ns) if late_ns < -APART_NS or late_ns > LATE_NS else 0.0
