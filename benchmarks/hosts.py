"""Three hosts with certificates: time of every hop, a bad, a cut and a crowded link."""

import argparse
import contextlib
import itertools
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from benchmarks.lib.system.site import ROOT, TIMEOUT_S, Heard, Log, Site
from benchmarks.lib.table import markdown, quantiles, write
from common.io.recording import open_recording
from common.runtime.latency import merge_stages, segments
from common.transport.zenoh_bus import ZenohBus, read_config
from people4d.client import Client
from people4d.messages import CompressedRgbdFrame, Message, Span, Track, Tracks
from people4d.topics import BY_NAME
from scripts.namespaces import Link, hosts, missing

SOURCE = ROOT / "deploy" / "demo" / "crossing.mcap"
GOOD = Link()
BAD = Link(delay_s=0.05, loss=0.05)
SLOW = Link(delay_s=0.005, rate_bps=10e6)
CUT_S = 10.0
RATE_HZ = 30.0


def listen(topic: str, file: Path) -> None:
    """Write down the messages of a topic until interrupted; runs on one of the hosts."""
    kind = BY_NAME[topic].message
    with (
        Client(timeout_s=TIMEOUT_S) as client,
        file.open("w", encoding="utf-8", buffering=1) as out,
        contextlib.suppress(KeyboardInterrupt),
    ):
        for arrival in client.arrivals(kind):
            message = arrival.message
            sent_ns = message.trace[-1].end_ns if message.trace else 0
            row: dict[str, Any] = {
                "arrived_s": arrival.received_ns / 1e9,
                "sequence": message.sequence,
                "sent_s": sent_ns / 1e9,
                "size": 0,
                "stages_ms": {},
            }
            if isinstance(message, CompressedRgbdFrame):
                row["size"] = len(message.rgb_jpeg) + len(message.depth_png)
            if isinstance(message, Tracks):
                row["stages_ms"] = {p.name: p.ms for p in merge_stages(segments(message.trace))}
            out.write(json.dumps(row) + "\n")


def send(topic: str, rate_hz: float) -> None:
    """Publish people or frames at a rate until interrupted; runs on one of the hosts."""
    (role,) = BY_NAME[topic].producers
    samples = list(itertools.islice(_samples(BY_NAME[topic].message), 30))
    bus = ZenohBus(read_config(None, "client", role=role), "robot", TIMEOUT_S)
    due_s = time.monotonic()
    with contextlib.closing(bus), contextlib.suppress(KeyboardInterrupt):
        for sequence in itertools.count():
            sample = samples[sequence % len(samples)]
            bus.publish(msgspec.structs.replace(sample, sequence=sequence, trace=()), _now)
            due_s += 1 / rate_hz
            time.sleep(max(due_s - time.monotonic(), 0.0))


def _samples(kind: type[Message]) -> Iterator[Message]:
    """Yield messages of a usual size."""
    if kind is not Tracks:
        yield from (message for _, message in open_recording(SOURCE).messages(kind))
        return
    person = Track(
        id=1,
        state="confirmed",
        position_m=np.ones(3),
        velocity_mps=np.ones(3),
        covariance=np.eye(6),
        yaw_rad=1.0,
        hits=9,
        age=9,
        time_since_update_s=0.0,
        detection=None,
        score=0.9,
    )
    people = tuple(msgspec.structs.replace(person, id=number) for number in range(1, 6))
    yield Tracks(
        stamp_ns=0, sequence=0, frame_id="map", tracker="none", camera="front", tracks=people
    )


def _now() -> Span:
    now_ns = time.time_ns()
    return Span(stage="sender.publish", process="sender@host", start_ns=now_ns, end_ns=now_ns)


def hops(heard: Sequence[Heard]) -> str:
    """Return the time of every stage, and of each hop between hosts, as a table."""
    where = {"camera": "nuc", "detector": "nuc", "reid": "nuc", "tracker": "tracker"}
    hop_names = {
        "detector.transport": "camera to detector: on the NUC, shared memory",
        "reid.transport": "detector to reid: on the NUC, shared memory",
        "tracker.transport": "NUC to tracker: detections through the router, TLS",
    }
    rows = []
    longest_first = sorted(heard, key=lambda one: len(one.stages_ms), reverse=True)
    for name in dict.fromkeys(name for one in longest_first for name in one.stages_ms):
        values = [one.stages_ms[name] for one in heard if name in one.stages_ms]
        service = name.partition(".")[0]
        rows.append([name, hop_names.get(name, where.get(service, "")), *quantiles(values)])
    last = "tracker to planner: people through the router, TLS twice"
    rows.append(["planner.transport", last, *quantiles([one.hop_ms for one in heard])])
    return markdown(["stage", "where", "p50 ms", "p95 ms", "p99 ms"], rows)


@dataclass(frozen=True)
class Phase:
    """Messages received by the planner and by the router's host in one period.

    Args:
        name: What was done to the link.
        planner: Messages received by the planner.
        near: Messages received on the router's host.
        begin_s: Wall clock of its begin.
        end_s: Wall clock of its end.
    """

    name: str
    planner: list[Heard]
    near: list[Heard]
    begin_s: float
    end_s: float

    def row(self) -> list[str]:
        """Return its line of the table."""
        got = {one.sequence for one in self.planner}
        lost = sum(one.sequence not in got for one in self.near)
        return [
            self.name,
            f"{self.rate_hz(self.near):.1f}",
            f"{self.rate_hz(self.planner):.1f}",
            *(quantiles([one.hop_ms for one in self.planner]) if self.planner else ["-"] * 3),
            f"{lost} of {len(self.near)}",
            f"{self._silence_s(self.near):.2f}",
            f"{self._silence_s(self.planner):.2f}",
        ]

    def rate_hz(self, heard: Sequence[Heard]) -> float:
        """Return how many of some messages there were in a second."""
        return len(heard) / (self.end_s - self.begin_s)

    def _silence_s(self, heard: Sequence[Heard]) -> float:
        times = [self.begin_s, *(one.arrived_s for one in heard), self.end_s]
        return max(after - before for before, after in itertools.pairwise(times))


PHASE_HEADER = [
    *("link of the planner", "people Hz on the NUC", "people Hz at the planner"),
    *("hop p50 ms", "p95 ms", "p99 ms", "lost on the link"),
    *("longest silence on the NUC s", "at the planner s"),
]


def phase(name: str, logs: tuple[Log, Log], seconds: float) -> Phase:
    """Wait for some time and return what was heard in it."""
    begin_s = time.time()
    time.sleep(seconds)
    end_s = time.time()
    time.sleep(2.0)  # what is on its way counts where it was sent
    planner, near = logs
    in_time = [one for one in planner.read() if begin_s <= one.sent_s < end_s]
    sent = [one for one in near.read() if begin_s <= one.sent_s < end_s]
    return Phase(name, in_time, sent, begin_s, end_s)


def cut(site: Site, logs: tuple[Log, Log], seconds: float) -> tuple[Phase, str]:
    """Cut the planner's link, heal it, and return what was heard and what became of it."""
    planner, _ = logs
    site.world.wire.link = Link(up=False)
    during = phase(f"cut for {seconds:g} s", logs, seconds - 2.0)
    before = len(planner.read())
    healed_s = time.time()
    site.world.wire.link = GOOD
    first = planner.wait_for_more(before)[before]
    after = phase("healed", logs, 5.0)
    heard = planner.read()
    sequences = [one.sequence for one in heard]
    back = sequences.index(first.sequence)
    gap = first.sequence - sequences[back - 1] - 1
    late = sum(one.sent_s < healed_s for one in heard[before:])
    return during, (
        f"Cut for {seconds:g} s and healed: the first people came "
        f"{first.arrived_s - healed_s:.1f} s after the link was back; {late} messages made while "
        f"it was cut came late, {gap} never came, which the gap in their numbers tells. From then "
        f"on {after.rate_hz(after.planner):.1f} a second came. On the NUC people went on at "
        f"{during.rate_hz(during.near):.1f} Hz throughout."
    )


def frames_beside(site: Site, logs: tuple[Log, Log], seconds: float) -> list[Phase]:
    """Ask for compressed frames over a slow link, and return people without and with them."""
    site.world.wire.link = SLOW
    alone = phase("10 Mbit/s", logs, seconds)
    with (
        site.sending("nuc", "compressed", RATE_HZ),
        site.listening("planner", "compressed", role="operator") as frames,
    ):
        beside = phase("", logs, seconds)
        images = frames.between(beside.begin_s, beside.end_s)
    site.world.wire.link = GOOD
    mbit = sum(one.size for one in images) * 8e-6 / seconds
    name = f"10 Mbit/s, beside frames ({len(images) / seconds:.1f} Hz, {mbit:.1f} Mbit/s)"
    return [alone, Phase(name, beside.planner, beside.near, beside.begin_s, beside.end_s)]


def measure_system(site: Site, seconds: float) -> str:
    """Return the times of all stages of the whole system, on good links."""
    site.up("nuc", "--host", "0.0.0.0", "--source", str(SOURCE), "--loop")
    site.up("tracker")
    with site.listening("planner") as planner:
        begin_s = time.time()
        time.sleep(seconds)
        table = hops(planner.between(begin_s, time.time()))
    site.close()
    return table


def measure_links(site: Site, seconds: float) -> tuple[str, str]:
    """Return what links of other quality do to people, as a table and in words."""
    with (
        site.router(),
        site.sending("tracker", "people", RATE_HZ),
        site.listening("planner") as planner,
        site.listening("nuc", role="operator") as near,
    ):
        logs = (planner, near)
        phases = [phase("good", logs, seconds)]
        site.world.wire.link = BAD
        phases.append(phase("5 % lost, 50 ms delay each way", logs, seconds))
        site.world.wire.link = GOOD
        during, text = cut(site, logs, CUT_S)
        phases += [during, *frames_beside(site, logs, seconds)]
    return markdown(PHASE_HEADER, [one.row() for one in phases]), text


def main() -> int:
    """Measure and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="short, and only printed")
    parser.add_argument("--listen", nargs=2, metavar=("TOPIC", "FILE"), help=argparse.SUPPRESS)
    parser.add_argument("--send", nargs=2, metavar=("TOPIC", "HZ"), help=argparse.SUPPRESS)
    flags = parser.parse_args()
    if flags.send:
        send(flags.send[0], float(flags.send[1]))
        return 0
    if flags.listen:
        listen(flags.listen[0], Path(flags.listen[1]))
        return 0
    if why := missing():
        print(f"skipped: {why}")
        return 0
    folder = Path(tempfile.mkdtemp(prefix="people4d-hosts-"))
    try:
        with hosts() as world, contextlib.closing(Site(world, folder)) as site:
            seconds = 6.0 if flags.quick else 30.0
            phases, text = measure_links(site, seconds)
            table = measure_system(site, seconds)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    if flags.quick:
        print(table, phases, text, sep="\n\n")
        return 0
    write(
        __file__,
        "Three hosts: what each hop takes, and what bad links do",
        "Three network namespaces as three hosts, set up as docs/launch/hosts.md says: camera, "
        "detector, appearance and router on the NUC, the tracker and the planner on hosts of their "
        "own, mutual TLS and access rules between them. All share the cores of one machine.",
        "## Every stage, on a good link",
        table,
        "## People on links of other quality",
        f"Five people at {RATE_HZ:g} Hz from the tracker's host. The planner's link is a wire made "
        "by this benchmark, because not every kernel can delay and lose packets itself. Lost are "
        "messages that a listener on the NUC heard and the planner did not. A message that comes "
        "late was sent again by TCP.",
        phases,
        text,
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
