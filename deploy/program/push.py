"""A camera of a running system with frames from a user program."""

import os
import queue
import socket
import threading
import time
from collections.abc import Iterator
from types import TracebackType
from typing import Any, Self

import numpy.typing as npt

from common.calibration.transforms_file import MAP
from common.runtime.loop import Loop
from common.transport.trace import ProcessId
from common.transport.zenoh_bus import ZenohBus, read_config
from deploy.program.images import CameraImages
from people4d.errors import ConfigError, People4dError
from people4d.messages import U8
from services.camera.build import build
from services.camera.calibration import Intrinsics
from services.camera.config import CameraConfig
from services.camera.source import Source, SourceFrame, SourceSetup

SYSTEM_S = 5.0  # maximum wait for the system [s]
POLL_S = 0.1  # period of checks while waiting [s]
CLOSE_S = 5.0  # maximum wait for the end of the camera [s]


class PushedFrames(Source):
    """Frames from another thread."""

    live = True
    calibrates_late = True

    def __init__(self) -> None:
        self._items: queue.Queue[SourceFrame | SourceSetup | None] = queue.Queue()

    def __iter__(self) -> Iterator[SourceFrame | SourceSetup]:
        """Yield items until `interrupt`."""
        while (item := self._items.get()) is not None:
            yield item

    def add_frame(self, item: SourceFrame | SourceSetup) -> None:
        """Queue an item; the camera drops frames that it cannot send in time."""
        self._items.put(item)

    def interrupt(self) -> None:
        """End the iteration."""
        self._items.put(None)


class Camera:
    """A camera of a running system; a context manager, or `close` at the end.

    The system is started without a camera: `people4d up --source push`. SourceError if name,
    intrinsics, pose or range are impossible; ConfigError if no system of this robot runs, or it has
    a camera of this name.

    Args:
        name: Name of the camera in keys and messages.
        intrinsics: Lens of the colour image, or its camera matrix (3x3) without distortion.
        pose: Pose (4x4) of the optical frame (x right, y down, z forward) in `parent` [m], see
            `mount`; None: level at the origin.
        parent: "map", or the frame of a moving base.
        max_depth_m: Larger readings of depth are not used [m].
        robot: Name of the robot.
        connect: Endpoint of the system's router, "tcp/192.168.1.7:7447"; empty: $PEOPLE4D_CONNECT,
            else this machine.
    """

    def __init__(
        self,
        name: str,
        intrinsics: Intrinsics | npt.ArrayLike,
        pose: npt.ArrayLike | None = None,
        parent: str = MAP,
        max_depth_m: float = 5.0,
        robot: str = "robot",
        connect: str = "",
    ) -> None:
        self._images = CameraImages(name, intrinsics, pose, parent, max_depth_m)
        self._source, self._error = PushedFrames(), ""
        self._node = build(CameraConfig(camera=name, playback="live"), self._source)
        environment = {**os.environ, **({"PEOPLE4D_CONNECT": connect} if connect else {})}
        self._bus = ZenohBus(read_config(None, "peer", environment, role="camera"), robot)
        process = ProcessId("camera", f"camera-{name}", socket.gethostname())
        try:
            _check_system(self._bus, process.instance)
        except ConfigError:
            self._bus.close()
            raise
        self._loop = Loop(self._node, self._bus, process)
        self._thread = threading.Thread(target=self._run, name=process.instance, daemon=True)
        self._thread.start()
        self._loop.ready.wait(SYSTEM_S)

    def push(self, rgb: U8, depth: npt.NDArray[Any], stamp_ns: int) -> None:
        """Send a frame; returns at once.

        SourceError if the images are invalid, or not later than the last ones; People4dError if the
        camera has ended.

        Args:
            rgb: HxWx3 of 8 bits, red first.
            depth: HxW aligned to colour: uint16 millimetres or float metres; 0 or NaN: no reading.
            stamp_ns: Acquisition time on the clock of this machine [ns], as time.time_ns().
        """
        if not self._thread.is_alive():
            raise People4dError(f"camera {self._images.name} has ended: {self._error or 'closed'}")
        first = self._images.info is None
        frame = self._images.accept(rgb, depth, stamp_ns)
        if first and self._images.info:
            setup = SourceSetup(self._images.info, [self._images.transform], False, stamp_ns)
            self._source.add_frame(setup)
        self._source.add_frame(frame)

    def problem(self) -> str:
        """Return the current limit of the camera, one sentence; empty if there is none."""
        return self._node.status().reason

    def close(self) -> None:
        """End the camera."""
        self._loop.stop()
        self._thread.join(CLOSE_S)
        self._bus.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _: type[BaseException] | None, __: BaseException | None, ___: TracebackType | None
    ) -> None:
        self.close()

    def _run(self) -> None:
        try:
            self._loop.run()
        except People4dError as error:
            self._error = str(error)


def _check_system(bus: ZenohBus, instance: str) -> None:
    """Wait for a tracker of the robot; ConfigError if there is none, or the camera runs already."""
    end_s = time.monotonic() + SYSTEM_S
    while True:
        present = {(service, name) for robot, service, name in bus.present() if robot == bus.robot}
        if ("camera", instance) in present:
            raise ConfigError(f"{instance} runs already", "Give this camera another name.")
        if any(service == "tracker" for service, _ in present):
            return
        if time.monotonic() > end_s:
            problem = f"no system of robot {bus.robot!r} runs"
            raise ConfigError(problem, "Start it without a camera: people4d up --source push.")
        time.sleep(POLL_S)
