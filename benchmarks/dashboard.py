"""Load of the page in the browser, and how soon it shows people.

The pipeline runs on the shipped recording as a live camera at 10 Hz, with no viewer, with
one viewer and with twenty, by turns: processor of the dashboard, age of people at a planner. In
lock-step the tracks with twenty viewers are compared byte for byte with those without. A viewer
that stops reading is timed until it is dropped. At last the whole system is started by `people4d
up --dashboard`, and a page of Chromium is opened when that returns.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np
import psutil
from playwright.sync_api import sync_playwright

from benchmarks.lib.system.live_camera import DEMO
from benchmarks.lib.system.services import Cluster, Listener, cluster
from benchmarks.lib.system.viewers import silent_viewer, viewers
from benchmarks.lib.table import markdown, spread, write
from common.transport.ports import free_port
from people4d.client import Client
from people4d.codec import encode
from people4d.messages import Health, Tracks

VIEWERS = (0, 1, 20)
CPU_LIMITS = {0: 2.0, 1: 10.0}  # [%] of a core, wanted
LATENCY_LIMIT_MS = 0.5  # wanted at most, added at p50 by twenty viewers
PAGE_LIMIT_S = 3.0
LIVE = "benchmarks.lib.system.live_camera:LiveDemo"
STORED = "benchmarks.lib.system.live_camera:StoredDemo"
LONG_WAITS = ("embedding_wait_s=60.0", "reorder_wait_s=60.0")
PIPELINE = ("detector", "reid", "tracker")
SETTLE_S = 3.0
TIMEOUT_S = 60.0
FLAGS = ("--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage")


@dataclass
class Load:
    """Measurements with one number of viewers, a value for each round."""

    cpu_percent: list[float] = field(default_factory=list)  # of one core
    p50_ms: list[float] = field(default_factory=list)
    images_hz: list[float] = field(default_factory=list)


@contextmanager
def running(tracker: tuple[str, ...] = ()) -> Iterator[tuple[Cluster, Client, int]]:
    """Start the dashboard and the pipeline but for its camera; the last value is the page's port.

    Args:
        tracker: Settings of the tracker.
    """
    port = free_port()
    with (
        tempfile.TemporaryDirectory() as logs,
        cluster(Path(logs)) as system,
        Listener(system.endpoint) as client,
    ):
        system.start("dashboard", "dashboard-1", (f"port={port}",))
        for service in PIPELINE:
            system.start(service, f"{service}-1", tracker if service == "tracker" else ())
        system.wait_ready(client, {"dashboard-1", *(f"{service}-1" for service in PIPELINE)})
        yield system, client, port


def start_live(system: Cluster, client: Client) -> None:
    """Start the camera, and wait for the first people."""
    system.start("camera", "camera-1", (f"source={LIVE}",))
    next(iter(client.messages(Tracks, timeout_s=TIMEOUT_S)))


def measure(system: Cluster, client: Client, port: int, count: int, seconds: float) -> list[float]:
    """Return processor [%], age of people at p50 [ms] and images a second with some viewers."""
    process = psutil.Process(system.processes["dashboard-1"].pid)
    with viewers(f"http://127.0.0.1:{port}/", count) as asked:
        time.sleep(SETTLE_S)
        images, busy_s, begin_s = asked(), spent(process), time.monotonic()
        ages_ms = []
        for arrival in client.arrivals(Tracks, timeout_s=TIMEOUT_S):
            ages_ms.append((arrival.received_ns - arrival.message.stamp_ns) / 1e6)
            if time.monotonic() - begin_s > seconds:
                break
        elapsed_s = time.monotonic() - begin_s
        busy_s, images = spent(process) - busy_s, asked() - images
    return [100 * busy_s / elapsed_s, float(np.median(ages_ms)), images / elapsed_s]


def spent(process: psutil.Process) -> float:
    """Return the time of the processor that a process has used [s]."""
    times = process.cpu_times()
    return float(times.user + times.system)


def loads(rounds: int, seconds: float) -> dict[int, Load]:
    """Measure by turns with each number of viewers."""
    found = {count: Load() for count in VIEWERS}
    with running() as (system, client, port):
        start_live(system, client)
        for number in range(rounds):
            print(f"load: round {number + 1} of {rounds}", flush=True)
            for count in VIEWERS:
                cpu, p50_ms, images_hz = measure(system, client, port, count, seconds)
                found[count].cpu_percent.append(cpu)
                found[count].p50_ms.append(p50_ms)
                found[count].images_hz.append(images_hz)
    return found


def dropped_after(seconds_max: float = 120.0) -> tuple[float, float]:
    """Return when a viewer that reads nothing is dropped [s], and the memory added [MiB]."""
    with running() as (system, client, port):
        start_live(system, client)
        process = psutil.Process(system.processes["dashboard-1"].pid)
        with viewers(f"http://127.0.0.1:{port}/", 1):
            time.sleep(SETTLE_S)
            before, begin_s = process.memory_info().rss, time.monotonic()
            with silent_viewer(f"http://127.0.0.1:{port}/"):
                for health in client.messages(Health, timeout_s=TIMEOUT_S):
                    elapsed_s = time.monotonic() - begin_s
                    if health.counters.get("viewers_stuck"):
                        return elapsed_s, (process.memory_info().rss - before) / 2**20
                    if elapsed_s > seconds_max:
                        break
    raise TimeoutError(f"the viewer was not dropped in {seconds_max} s")


def tracks_of(count: int, frames: int) -> list[bytes]:
    """Return the tracks of a run in lock-step with some viewers, without their traces."""
    camera = (f"source={STORED}", "loop=true", f"max_frames={frames}", "playback=lockstep")
    with (
        running(LONG_WAITS) as (system, client, port),
        viewers(f"http://127.0.0.1:{port}/", count),
    ):
        time.sleep(SETTLE_S)
        messages = client.messages(Tracks, timeout_s=TIMEOUT_S)
        system.start("camera", "camera-1", (*camera, f"answer_timeout_s={TIMEOUT_S}"))
        found: list[bytes] = []
        last = -1
        for tracks in messages:
            if tracks.sequence > last:  # else a prediction, where the machine was slow
                last = tracks.sequence
                found.append(encode(msgspec.structs.replace(tracks, trace=())))
            if last >= frames - 1:
                break
    return found


def page_s(rounds: int) -> tuple[list[float], list[float]]:
    """Return the times from the return of `up` until the page is loaded and shows people [s]."""
    loaded, people = [], []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=list(FLAGS)
        )
        for number in range(rounds):
            print(f"page: round {number + 1} of {rounds}", flush=True)
            with tempfile.TemporaryDirectory(prefix="p4d") as state:
                port, page_port = free_port(), free_port()
                environment = {**os.environ, "PEOPLE4D_STATE": state, "OMP_NUM_THREADS": "1"}
                cli = [sys.executable, "-m", "deploy.cli"]
                flags = ["--port", str(port), "--source", str(DEMO), "--loop", "--dashboard", "-d"]
                page = browser.new_page()
                command = [*cli, "up", *flags, "--set", f"dashboard.port={page_port}"]
                subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)
                try:
                    begin_s = time.monotonic()
                    page.goto(f"http://127.0.0.1:{page_port}/")
                    loaded.append(time.monotonic() - begin_s)
                    page.locator("#table tbody tr").first.wait_for()
                    people.append(time.monotonic() - begin_s)
                    page.close()
                finally:
                    subprocess.run(
                        [*cli, "down"], env=environment, check=True, stdout=subprocess.DEVNULL
                    )
        browser.close()
    return loaded, people


def main() -> None:
    """Measure, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=15.0, help="of each measurement")
    parser.add_argument("--frames", type=int, default=150, help="compared byte for byte")
    options = parser.parse_args()
    found = loads(options.rounds, options.seconds)
    added_ms = {
        count: [one - none for one, none in zip(found[count].p50_ms, found[0].p50_ms, strict=True)]
        for count in VIEWERS
    }
    without, with_viewers = tracks_of(0, options.frames), tracks_of(VIEWERS[-1], options.frames)
    stuck_s, stuck_mib = dropped_after()
    loaded_s, people_s = page_s(3)
    rows = [
        [
            str(count),
            spread(load.cpu_percent, "{:.1f}"),
            f"{CPU_LIMITS[count]:.0f}" if count in CPU_LIMITS else "",
            spread(load.images_hz, "{:.1f}") if count else "",
            spread(load.p50_ms, "{:.1f}"),
            spread(added_ms[count]) if count else "",
        ]
        for count, load in found.items()
    ]
    header = ["viewers", "processor of the dashboard, % of a core", "wanted at most"]
    header += ["images a second at one viewer", "people at a planner, p50 ms", "added ms"]
    same = without == with_viewers and len(without) == options.frames
    write(
        __file__,
        "Load of the page in the browser",
        f"The shipped recording as a live camera at 10 Hz, {options.rounds} rounds of "
        f"{options.seconds:.0f} s by turns. Viewers are connections without a browser that read "
        "all they are sent, in a process of the lowest priority on the same machine. Added by "
        f"twenty viewers at p50, wanted at most {LATENCY_LIMIT_MS} ms: pair by pair.",
        markdown(header, rows),
        f"Tracks of {options.frames} frames in lock-step with {VIEWERS[-1]} viewers and without: "
        f"{'the same' if same else 'not the same'} byte for byte, without their traces.",
        f"A viewer that reads nothing was dropped after {stuck_s:.0f} s (what the sockets hold "
        f"first, then `dashboard.stuck_s`); the process held {stuck_mib:.1f} MiB more then.",
        f"Page of Chromium after `people4d up --dashboard` has returned, wanted at most "
        f"{PAGE_LIMIT_S:.0f} s: loaded after {spread(loaded_s)} s, with people after "
        f"{spread(people_s)} s, {len(people_s)} starts.",
    )


if __name__ == "__main__":
    main()
