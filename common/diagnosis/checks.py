"""Checks of a running system: each derives diagnostics from the evidence."""

from collections.abc import Callable, Iterator, Sequence

from common.diagnosis.camera_checks import CAMERA_CHECKS
from common.diagnosis.clock_checks import clocks, stamps
from common.diagnosis.event_table import EVENTS, REJECTED
from common.diagnosis.evidence import Diagnostic, Evidence, Vitals, ok, problem, warning
from common.diagnosis.owner_checks import owners
from common.text import listed

NEEDED = ("camera", "detector", "tracker")
SITE = "site"  # service that runs under its own robot name, without the others
MOST = 0.5  # minimum share of faulty frames in a problem
SAME_RELEASE = "Run the same people4d release on all machines."


def services(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that all services run, and under this robot's name."""
    running = sorted({v.last.service for v in evidence.vitals.values()})
    needed: tuple[str, ...] = NEEDED
    if SITE in running and not set(running) & set(NEEDED):
        needed = (SITE,)
    elif any(v.since("received_detections") for v in evidence.of_service("tracker")):
        needed = ("tracker",)  # cameras of the tracker may run under other robot names
    missing = [name for name in needed if name not in running]
    robots = sorted({robot for robot, _, _ in evidence.present} - {evidence.robot})
    present = {name for robot, _, name in evidence.present if robot == evidence.robot}
    silent = sorted(present - set(evidence.vitals))
    if not running and robots:
        what = f"no robot is called {evidence.robot}; there is {', '.join(robots)}"
        yield problem("robot", what, f"Add --robot {robots[0]}.")
    elif silent:
        what = f"{listed(silent)} sent no heartbeat"
        hint = "It hangs: the watchdog of people4d up starts it again, else kill -9 it."
        yield problem("services", what, hint, *silent)
    elif missing:
        others_run = f"; {', '.join(running)} does" if running else ""
        what = f"{', '.join(missing)} does not run{others_run}"
        yield problem("services", what, "See why with people4d logs, or start it: people4d up.")
    else:
        yield ok("services", f"{', '.join(running)} run")


def names(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that each name is used once, and that one tracker runs."""
    twice = sorted(name for name, v in evidence.vitals.items() if len(v.pids) > 1)
    trackers = [v.last for v in evidence.of_service("tracker")]
    if twice:
        what = f"several processes are named {', '.join(twice)}, or one has just restarted"
        yield problem("twice", what, "Give each its own name: --instance.", *twice)
    elif len(trackers) > 1:
        listing = ", ".join(f"{t.instance} on {t.host} (process {t.pid})" for t in trackers)
        what = f"{len(trackers)} trackers publish people, each with ids of its own: {listing}"
        yield problem("twice", what, "Stop all but one.", *(t.instance for t in trackers))


def unannounced(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that each process with heartbeats has a token, which vanishes with the process."""
    present = {name for robot, _, name in evidence.present if robot == evidence.robot}
    absent = sorted(set(evidence.vitals) - present)
    if present and absent:
        what = f"heartbeats arrive from {listed(absent)}, without announcement"
        hint = "They ended just now, or are forged, which keys prevent: people4d keys."
        yield warning("unannounced", what, hint, *absent)


def releases(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that the same release runs everywhere."""
    found: dict[str, list[str]] = {evidence.release: ["here"]}
    for name, vitals in evidence.vitals.items():
        found.setdefault(vitals.last.release or "an older one", []).append(name)
    if "version" in evidence.refusal and evidence.refused:
        topics = ", ".join(sorted(evidence.refused))
        what = f"messages of another release arrive ({topics}): {evidence.refusal}"
        yield problem("release", what, SAME_RELEASE)
    elif len(found) > 1:
        listing = "; ".join(f"{r}: {', '.join(who)}" for r, who in sorted(found.items()))
        yield problem("release", f"releases differ: {listing}", SAME_RELEASE)
    elif evidence.vitals:
        yield ok("release", f"everyone runs {evidence.release}")


def frames(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that frames leave the camera and reach the detector."""
    cameras, detectors = evidence.of_service("camera"), evidence.of_service("detector")
    sent = [v.since("sent_frames", "sent_compressed") for v in cameras]
    about = [v.last.instance for v in detectors]
    if not cameras or any(v.since(*REJECTED) for v in cameras):
        return
    if not all(sent):
        quiet = cameras[sent.index(0)]
        name, why = quiet.last.instance, quiet.fault or "it says nothing of why"
        hint = "Is it plugged in, or its recording at its end? See people4d logs camera."
        yield problem("frames", f"{name} sends no frames: {why}", hint, name, *about)
    elif detectors and not any(v.since("received_frames") for v in detectors):
        what = "frames leave the camera, but do not reach the detector"
        hint = (
            "Raw frames do not leave their host: run the detector where the camera runs. In "
            "containers, share shm_size and ipc as compose.yaml does."
        )
        yield problem("frames", what, hint, *about)
    else:
        yield ok("frames", f"{sum(sent) / max(evidence.elapsed_s, 0.1):.0f} frames a second arrive")


def pairs(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that colour and depth images have the same time."""
    for vitals in evidence.of_service("camera"):
        alone, sent = vitals.total("unpaired", "loose_pairs"), vitals.total("sent_frames")
        if alone > MOST * max(sent, 1):
            what = f"colour and depth are not of the same time: {alone} pictures, {sent} pairs"
            hint = (
                "Turn on the camera's synchronisation and depth registered to colour; "
                "options.sync_slop_s of the source says how far apart they may be."
            )
            yield problem("pairs", what, hint, vitals.last.instance)


def events(evidence: Evidence) -> Iterator[Diagnostic]:
    """Report each counted event of EVENTS."""
    for check, level, service, counter, what, hint in EVENTS:
        for vitals in evidence.of_service(service):
            if vitals.since(counter):
                name = vitals.last.instance
                text = what.format(name=name, fault=vitals.fault or counter)
                yield Diagnostic(check=check, level=level, what=text, hint=hint, about=(name,))


def exceptions(evidence: Evidence) -> Iterator[Diagnostic]:
    """Report exceptions in the code of a process."""
    for name, vitals in sorted(evidence.vitals.items()):
        count, service = vitals.total("errors"), vitals.last.service
        hint = f"people4d logs {service} has the traceback: it is a fault of the code, report it."
        if vitals.since("errors"):
            what = f"{name} fails, {count} times since its start: {vitals.fault}"
            yield problem("exceptions", what, hint, name)
        elif count:
            yield warning("exceptions", f"{name} failed {count} times since its start", hint, name)


def calibration(evidence: Evidence) -> Iterator[Diagnostic]:
    """Report the known calibrations and transforms."""
    for vitals in evidence.of_service("tracker"):
        if "no transform" in vitals.last.reason:
            hint = (
                "Set camera.mount_xyz_m, mount_rpy_rad and mount_parent, or publish the transform."
            )
            yield problem("transform", vitals.last.reason, hint, vitals.last.instance)
            return
    infos, transforms = evidence.infos.values(), evidence.transforms.values()
    unusable = [
        v for v in evidence.of_service("detector") if v.since("no_calibration", "wrong_size")
    ]
    if infos and not unusable:
        listing = ", ".join(f"{info.camera} {info.width}x{info.height}" for info in infos)
        yield ok("calibration", f"known: {listing}")
    if transforms:
        listing = ", ".join(f"{t.child} in {t.parent}" for t in transforms)
        yield ok("transform", f"known: {listing}")


def depth(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that depth images are not empty."""
    for vitals in evidence.of_service("detector"):
        empty = vitals.since("no_depth")
        # Heartbeats of both processes are not simultaneous
        came = max(vitals.since("frames"), empty)
        if empty and empty >= MOST * came:
            what = f"depth is all zero in {empty} of {came} frames: people have no positions"
            hint = (
                "Is the depth stream on, its lens free, and its unit millimetres in 16 bits? "
                "Sunlight blinds some sensors."
            )
            yield problem("depth", what, hint, vitals.last.instance)


def load(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that the machine keeps up."""
    slow = {name: part for name, v in evidence.vitals.items() if (part := _slowness(v))}
    if slow:
        hint = (
            "Choose a smaller model (people4d models), run more detectors (people4d scale "
            "detector=2) or send fewer frames (--set camera.stride=2)."
        )
        listing = "; ".join(f"{name} is {part}" for name, part in slow.items())
        yield warning("load", listing, hint, *slow)
    elif evidence.vitals:
        yield ok("load", "everyone keeps up")


def _slowness(vitals: Vitals) -> str:
    """Return the report of a process on input that is too fast; empty if there is none."""
    parts = vitals.last.reason.split("; ")
    return next((p for p in parts if "too slow" in p or "overflows" in p), "")


def hanging(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that no process is stalled."""
    stalled = [v.last for v in evidence.vitals.values() if v.last.state == "stalled"]
    if stalled:
        listing = "; ".join(f"{s.instance} is stalled: {s.reason}" for s in stalled)
        hint = (
            "With people4d up it is started again when that lasts, and its log then says in which "
            f"line it was: people4d logs {stalled[0].service}. kill -9 does so at once."
        )
        yield problem("hanging", listing, hint, *(s.instance for s in stalled))


def people(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that people are detected, have positions and are tracked."""
    found = [d for message in evidence.detections for d in message.detections]
    with_position = sum(d.position_m is not None for d in found)
    if not evidence.detections:
        return
    if not found:
        what = f"the detector finds no person in {len(evidence.detections)} frames"
        hint = (
            "Are people in view, upright, lit, and nearer than about 8 m? See its images: "
            "people4d up --report DIR."
        )
        yield warning("people", what, hint)
    elif not with_position:
        what = f"{len(found)} people are found, but none has a position"
        hint = "Depth is missing where people are: are they within the sensor's range?"
        yield problem("people", what, hint)
    elif evidence.tracks and not any(message.tracks for message in evidence.tracks):
        what = f"{with_position} people are found with a position, but no track is published"
        hint = "Does each stay for tracker.strongsort3d.n_init frames? See people4d ps for losses."
        yield warning("people", what, hint)


def output(evidence: Evidence) -> Iterator[Diagnostic]:
    """Check that people are published."""
    if evidence.tracks:
        rate_hz = len(evidence.tracks) / max(evidence.elapsed_s, 0.1)
        most = max(len(m.tracks) for m in evidence.tracks)
        what = f"{rate_hz:.0f} messages about people a second, of up to {most} people"
        sent = sum(v.since("sent_frames", "sent_compressed") for v in evidence.of_service("camera"))
        if len(evidence.tracks) < MOST * sent:
            arrive_hz = sent / max(evidence.elapsed_s, 0.1)
            hint = "People are late or missing in between: see people4d top for the slowest stage."
            yield warning("output", f"{what}, but {arrive_hz:.0f} frames a second arrive", hint)
        else:
            yield ok("output", what)
    elif evidence.of_service("tracker") or evidence.of_service(SITE):
        hint = "See the problems above, else people4d logs tracker."
        yield problem("output", "no people message arrives", hint)


def others(diagnostics: Sequence[Diagnostic], evidence: Evidence) -> Iterator[Diagnostic]:
    """Report reasons in heartbeats that no check explains."""
    explained = {name for diagnostic in diagnostics for name in diagnostic.about}
    for name, vitals in sorted(evidence.vitals.items()):
        if vitals.fault and name not in explained and vitals.last.state != "starting":
            what = f"{name} is {vitals.last.state}: {vitals.fault}"
            hint = f"See people4d logs {vitals.last.service}."
            yield warning("state", what, hint, name)


CHECKS: tuple[Callable[[Evidence], Iterator[Diagnostic]], ...] = (
    *(services, names, unannounced, owners, releases, clocks, stamps, exceptions, frames, pairs),
    *(*CAMERA_CHECKS, events, calibration, depth, load, hanging, people, output),
)


def examine(evidence: Evidence) -> list[Diagnostic]:
    """Return the diagnostics of all checks, in the order of the pipeline."""
    diagnostics = [diagnostic for check in CHECKS for diagnostic in check(evidence)]
    return [*diagnostics, *others(diagnostics, evidence)]
