"""Checks of a system that runs: each looks at what was heard and says what is wrong."""

from collections.abc import Callable, Sequence

from deploy.doctor.diagnostic import Diagnostic, ok, problem, warning
from deploy.doctor.evidence import Evidence, Vitals
from people4d.messages import Tracks

NEEDED = ("camera", "detector", "tracker")
APART_NS = 50_000_000  # [ns] by which clocks may differ before people are published too late
LATE_NS = 1_000_000_000  # [ns] heartbeats are never so long in transit
MOST = 0.5  # share of frames from which on a fault is one of all of them

Check = Callable[[Evidence], Sequence[Diagnostic]]


def services(evidence: Evidence) -> Sequence[Diagnostic]:
    """Look whether all services run, and under this robot's name."""
    there = sorted({v.last.service for v in evidence.vitals.values()})
    missing = [name for name in NEEDED if name not in there]
    robots = sorted({robot for robot, _, _ in evidence.present} - {evidence.robot})
    if not there and robots:
        what = f"no robot is called {evidence.robot}; there is {', '.join(robots)}"
        return [problem("robot", what, f"Add --robot {robots[0]}.")]
    silent = _silent(evidence)
    if silent:
        what = f"{', '.join(silent)} sent no heartbeat"
        hint = "It hangs: the watchdog of people4d up starts it again, else kill -9 it."
        return [problem("services", what, hint, *silent)]
    if missing:
        what = f"{', '.join(missing)} does not run" + (
            f"; {', '.join(there)} does" if there else ""
        )
        return [problem("services", what, "See why with people4d logs, or start it: people4d up.")]
    return [ok("services", f"{', '.join(there)} run")]


def _silent(evidence: Evidence) -> list[str]:
    """Return who is there by token, but was not heard."""
    present = {name for robot, _, name in evidence.present if robot == evidence.robot}
    return sorted(present - set(evidence.vitals))


def names(evidence: Evidence) -> Sequence[Diagnostic]:
    """Look whether anything runs twice that must not."""
    twice = sorted(name for name, v in evidence.vitals.items() if len(v.pids) > 1)
    if twice:
        what = f"several processes call themselves {', '.join(twice)}, or one started anew just now"
        return [problem("twice", what, "Give each its own name: --instance.", *twice)]
    trackers = [v.last for v in evidence.of("tracker")]
    if len(trackers) > 1:
        listing = ", ".join(f"{t.instance} on {t.host} (process {t.pid})" for t in trackers)
        what = f"{len(trackers)} trackers tell people at once, with numbers of their own: {listing}"
        return [problem("twice", what, "Stop all but one.", *(t.instance for t in trackers))]
    return []


def releases(evidence: Evidence) -> Sequence[Diagnostic]:
    """Look whether the same release runs everywhere."""
    if "version" in evidence.refusal and evidence.refused:
        topics = ", ".join(sorted(evidence.refused))
        what = f"messages of another release come ({topics}): {evidence.refusal}"
        return [problem("release", what, "Run the same people4d release on all machines.")]
    found: dict[str, list[str]] = {evidence.release: ["here"]}
    for name, vitals in evidence.vitals.items():
        found.setdefault(vitals.last.release or "an older one", []).append(name)
    if len(found) > 1:
        listing = "; ".join(f"{r}: {', '.join(who)}" for r, who in sorted(found.items()))
        hint = "Run the same people4d release on all machines."
        return [problem("release", f"releases differ: {listing}", hint)]
    return [ok("release", f"everyone runs {evidence.release}")] if evidence.vitals else []


def clocks(evidence: Evidence) -> Sequence[Diagnostic]:
    """Look whether the clocks of the hosts agree, and whether one was set."""
    apart: dict[str, str] = {}
    for vitals in evidence.vitals.values():
        behind_ns, host = _behind_ns(vitals), vitals.last.host
        if behind_ns:
            direction = "behind" if behind_ns > 0 else "ahead"
            apart[host] = f"{abs(behind_ns) / 1e6:.0f} ms {direction}"
    if apart:
        listing = ", ".join(f"{host} is {how}" for host, how in sorted(apart.items()))
        hint = "Let all hosts keep time by one server: chrony or systemd-timesyncd."
        return [problem("clocks", f"clocks of hosts are apart: {listing}", hint)]
    stepped = sorted(name for name, v in evidence.vitals.items() if v.since("clock_steps"))
    if stepped:
        what = f"a clock was set while {', '.join(stepped)} ran"
        return [problem("clocks", what, "Let it be steered, not set: chrony does, date does not.")]
    jumps = sum(v.total("stamp_jumps", "clock_resets") for v in evidence.vitals.values())
    if jumps:
        what = f"stamps of frames jumped {jumps} times since the start: people got new numbers"
        hint = "A recording that is repeated does so; of a live camera, look at its host's clock."
        return [warning("clocks", what, hint)]
    return [ok("clocks", "all clocks agree")] if evidence.vitals else []


def _behind_ns(vitals: Vitals) -> float:
    """Return how far the clock of a host is surely behind, 0 if that is within bounds."""
    gauges = vitals.last.gauges
    if "clock_offset_ms" in gauges:
        ahead_ns, error_ns = gauges["clock_offset_ms"] * 1e6, gauges["clock_error_ms"] * 1e6
        return -ahead_ns if abs(ahead_ns) - error_ns > APART_NS else 0.0
    # Without a reference: a heartbeat cannot come before it was sent, nor very late.
    late_ns = vitals.late_ns
    return float(late_ns) if late_ns < -APART_NS or late_ns > LATE_NS else 0.0


def frames(evidence: Evidence) -> Sequence[Diagnostic]:
    """Look whether frames leave the camera and reach the detector."""
    cameras, detectors = evidence.of("camera"), evidence.of("detector")
    quiet = [v for v in cameras if not v.since("sent_frames", "sent_compressed")]
    for vitals in quiet:
        name, why = vitals.last.instance, vitals.fault or "it says nothing of why"
        what = f"{name} sends no frames: {why}"
        hint = "Is it plugged in, or its recording at its end? people4d logs camera tells more."
        return [problem("frames", what, hint, name, *(v.last.instance for v in detectors))]
    if not cameras:
        return []
    if detectors and not any(v.since("received_frames") for v in detectors):
        what = "frames leave the camera, but do not reach the detector"
        hint = (
            "Raw frames do not leave their host: run the detector where the camera runs. In "
            "containers, share shm_size and ipc as compose.yaml does."
        )
        return [problem("frames", what, hint, *(v.last.instance for v in detectors))]
    rate_hz = sum(v.since("sent_frames", "sent_compressed") for v in cameras)
    return [ok("frames", f"{rate_hz / max(evidence.elapsed_s, 0.1):.0f} frames a second come")]


def pairs(evidence: Evidence) -> Sequence[Diagnostic]:
    """Look whether colour and depth belong together."""
    for vitals in evidence.of("camera"):
        alone, sent = vitals.total("unpaired", "loose_pairs"), vitals.total("sent_frames")
        if alone > MOST * max(sent, 1):
            what = f"colour and depth are not of the same time: {alone} pictures, {sent} pairs"
            hint = (
                "Turn on the camera's synchronisation and depth registered to colour; "
                "options.sync_slop_s of the source says how far apart they may be."
            )
            return [problem("pairs", what, hint, vitals.last.instance)]
    return []


def calibration(evidence: Evidence) -> Sequence[Diagnostic]:
    """Look whether the camera's intrinsics are known and fit."""
    for vitals in evidence.of("detector"):
        name = vitals.last.instance
        if vitals.since("no_calibration"):
            what = "no CameraInfo comes: frames are dropped, since detections get no positions"
            hint = "Give the camera its calibration: --set camera.options.calibration=FILE."
            return [problem("calibration", what, hint, name)]
        if vitals.since("wrong_size"):
            what = f"frames are not of the size that CameraInfo tells: {vitals.fault}"
            hint = "Calibrate at the size that is streamed, or stream at the size calibrated."
            return [problem("calibration", what, hint, name)]
    if not evidence.infos:
        return []
    listing = ", ".join(f"{i.camera} {i.width}x{i.height}" for i in evidence.infos.values())
    return [ok("calibration", f"known: {listing}")]


def transforms(evidence: Evidence) -> Sequence[Diagnostic]:
    """Look whether it is known where the cameras stand."""
    for vitals in evidence.of("tracker"):
        if "no transform" in vitals.last.reason:
            hint = (
                "Set camera.mount_xyz_m, mount_rpy_rad and mount_parent, or publish the transform."
            )
            return [problem("transform", vitals.last.reason, hint, vitals.last.instance)]
        if vitals.since("predicted_base"):
            what = "odometry comes too late or not: the robot's motion is guessed"
            hint = "Is odometry published (people4d ps), at 20 Hz or more, with stamps in time?"
            return [warning("odometry", what, hint, vitals.last.instance)]
    if not evidence.transforms:
        return []
    listing = ", ".join(f"{t.child} in {t.parent}" for t in evidence.transforms.values())
    return [ok("transform", f"known: {listing}")]


def depth(evidence: Evidence) -> Sequence[Diagnostic]:
    """Look whether depth images hold anything."""
    for vitals in evidence.of("detector"):
        empty, came = vitals.since("no_depth"), vitals.since("frames")
        if empty and empty >= MOST * came:
            what = f"depth is all zero in {empty} of {came} frames: people have no positions"
            hint = (
                "Is the depth stream on, its lens free, and its unit millimetres in 16 bits? "
                "Sunlight blinds some sensors."
            )
            return [problem("depth", what, hint, vitals.last.instance)]
    return []


def model(evidence: Evidence) -> Sequence[Diagnostic]:
    """Look whether networks fail."""
    for service, counter in (("detector", "model_errors"), ("reid", "embedder_errors")):
        for vitals in evidence.of(service):
            if vitals.since(counter):
                hint = "people4d models --verify checks the file; another: --model NAME."
                return [problem("model", vitals.fault, hint, vitals.last.instance)]
    return []


def load(evidence: Evidence) -> Sequence[Diagnostic]:
    """Look whether the machine keeps up."""
    slow = [v for v in evidence.vitals.values() if _slowness(v)]
    if not slow:
        return [ok("load", "everyone keeps up")] if evidence.vitals else []
    listing = "; ".join(f"{v.last.instance} is {_slowness(v)}" for v in slow)
    hint = (
        "Choose a smaller model (people4d models), run more detectors (people4d scale detector=2) "
        "or send fewer frames (--set camera.stride=2)."
    )
    return [warning("load", listing, hint, *(v.last.instance for v in slow))]


def _slowness(vitals: Vitals) -> str:
    """Return what a process says of input that comes too fast, empty if nothing."""
    parts = vitals.last.reason.split("; ")
    return next((p for p in parts if "too slow" in p or "overflows" in p), "")


def hanging(evidence: Evidence) -> Sequence[Diagnostic]:
    """Look whether anyone does not go on."""
    stalled = [v for v in evidence.vitals.values() if v.last.state == "stalled"]
    if not stalled:
        return []
    listing = "; ".join(f"{v.last.instance} is stalled: {v.last.reason}" for v in stalled)
    hint = (
        "With people4d up it is started again when that lasts, and its log then says in which "
        f"line it was: people4d logs {stalled[0].last.service}. kill -9 does so at once."
    )
    return [problem("hanging", listing, hint, *(v.last.instance for v in stalled))]


def people(evidence: Evidence) -> Sequence[Diagnostic]:
    """Check that people are detected, have positions and are tracked."""
    found = [d for message in evidence.detections for d in message.detections]
    if not evidence.detections:
        return []
    if not found:
        what = f"the detector finds no person in {len(evidence.detections)} frames"
        hint = (
            "Are people in view, upright, lit, and nearer than about 8 m? See its images: "
            "people4d up --report DIR."
        )
        return [warning("people", what, hint)]
    with_position = sum(d.position_m is not None for d in found)
    if not with_position:
        what = f"{len(found)} people are found, none of them has a position"
        hint = "Depth is missing where people are: are they within the sensor's range?"
        return [problem("people", what, hint)]
    shown = [len(message.tracks) for message in evidence.tracks]
    if evidence.tracks and not any(shown):
        what = f"{with_position} people are found with a position, but no track is published"
        hint = "Does each stay for tracker.strongsort3d.n_init frames? See people4d ps for losses."
        return [warning("people", what, hint)]
    return []


def output(evidence: Evidence) -> Sequence[Diagnostic]:
    """Check that people are published."""
    non_empty: list[Tracks] = [m for m in evidence.tracks if m.tracks]
    if not evidence.tracks:
        if not evidence.of("tracker"):
            return []
        hint = "What stands above explains it; else see people4d logs tracker."
        return [problem("output", "no message about people comes", hint)]
    rate_hz = len(evidence.tracks) / max(evidence.elapsed_s, 0.1)
    most = max((len(m.tracks) for m in non_empty), default=0)
    return [ok("output", f"{rate_hz:.0f} messages about people a second, of up to {most} people")]


def others(diagnostics: Sequence[Diagnostic], evidence: Evidence) -> list[Diagnostic]:
    """Return what processes say of themselves and no check explains."""
    explained = {name for diagnostic in diagnostics for name in diagnostic.about}
    said = []
    for name, vitals in sorted(evidence.vitals.items()):
        if vitals.fault and name not in explained and vitals.last.state != "starting":
            what = f"{name} is {vitals.last.state}: {vitals.fault}"
            hint = f"people4d logs {vitals.last.service} may tell more."
            said.append(warning("state", what, hint, name))
    return said


CHECKS: tuple[Check, ...] = (
    *(services, names, releases, clocks, frames, pairs, calibration, transforms, depth),
    *(model, hanging, load, people, output),
)


def examine(evidence: Evidence) -> list[Diagnostic]:
    """Return the diagnostics of all checks, in the order of the pipeline."""
    diagnostics = [diagnostic for check in CHECKS for diagnostic in check(evidence)]
    return diagnostics + others(diagnostics, evidence)
