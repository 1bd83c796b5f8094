"""Services as processes or threads without a launcher, and cameras that play from memory."""

import contextlib
import importlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from itertools import count, islice

from common.config import load
from common.runtime.loop import Loop, LoopSettings
from common.transport.trace import ProcessId
from deploy.launcher.joined import config_record
from people4d.messages import Health
from services.camera.recording import RecordingOptions, RecordingSource
from services.camera.source import Source, SourceFrame
from tests import DEMO
from tests.network import Network, Watcher


class StoredCamera(Source):
    """The first frames of the demo recording with their own stamps.

    Args:
        frames: Number of frames held in memory.
        stride: Frames of the recording from one to the next.
    """

    def __init__(self, frames: int = 12, stride: int = 1) -> None:
        recording = RecordingSource(DEMO, RecordingOptions())
        self.info, self.transforms = recording.info, recording.transforms
        items = (item for item in recording if isinstance(item, SourceFrame))
        self._frames = list(islice(items, 0, frames * stride, stride))

    def __iter__(self) -> Iterator[SourceFrame]:
        return iter(self._frames)


class LiveCamera(StoredCamera):
    """Four frames of the demo recording over and over, stamped when they are released."""

    live = True

    def __init__(self, rate_hz: float) -> None:
        super().__init__(frames=4, stride=5)
        self._period_s = 1 / rate_hz

    def __iter__(self) -> Iterator[SourceFrame]:
        begin_s = time.monotonic()
        for number in count():
            time.sleep(max(0.0, begin_s + number * self._period_s - time.monotonic()))
            frame = self._frames[number % len(self._frames)]
            yield SourceFrame(frame.rgb, frame.depth_mm, time.time_ns())


def start(
    network: Network, robot: str, instance: str, settings: Sequence[str] = (), **environment: str
) -> "subprocess.Popen[bytes]":
    """Start the process of a service."""
    service = instance.partition("-")[0]
    command = [sys.executable, "-m", f"services.{service}", "--robot", robot]
    command += ["--instance", instance]
    command += [flag for setting in settings for flag in ("--set", setting)]
    environment = network.environment | {"OMP_NUM_THREADS": "1"} | environment
    return subprocess.Popen(command, env=os.environ | environment)


def wait_ready(watcher: Watcher, instances: set[str]) -> None:
    """Wait until processes are ready, or degraded for lack of input."""
    waiting = set(instances)
    while waiting:
        health = watcher.wait(Health, lambda h: h.state in ("ready", "degraded"))
        waiting.discard(health.instance)


@contextlib.contextmanager
def pipeline(
    network: Network, robot: str, settings: dict[str, Sequence[str]], state: str
) -> Iterator[None]:
    """Run services until the block ends; the last, the camera, starts when the others are ready."""
    *first, camera = settings
    watcher = Watcher(network.open(robot), Health)
    with contextlib.ExitStack() as stack:

        def run(name: str) -> None:
            process = start(network, robot, name, settings[name], PEOPLE4D_STATE=state)
            stack.callback(process.wait)
            stack.callback(process.kill)

        for name in first:
            run(name)
        wait_ready(watcher, set(first))
        run(camera)
        yield


@contextlib.contextmanager
def threads(network: Network, robot: str, settings: dict[str, Sequence[str]]) -> Iterator[None]:
    """Run services as `pipeline` does, each with its own session, in threads of this process."""
    *first, _ = settings
    watcher = Watcher(network.open(robot), Health)
    with contextlib.ExitStack() as stack:

        def run(name: str) -> None:
            service = name.partition("-")[0]
            config = load(config_record(service), service, overrides=settings[name], environment={})
            node = importlib.import_module(f"services.{service}.build").build(config)
            bus = network.open(robot, "peer")
            loop = Loop(node, bus, ProcessId(service, name, "host"), LoopSettings(node.workers))
            thread = threading.Thread(target=loop.run)
            thread.start()
            stack.callback(thread.join)
            stack.callback(loop.stop)

        for number, name in enumerate(settings):
            if number == len(first):
                wait_ready(watcher, set(first))
            run(name)
        yield
