"""Luxonis OAK-D, by depthai 3."""

import re
import time
from datetime import timedelta
from typing import Any

import numpy as np

from cameras.sdk import WAIT_MS, SdkCamera
from people4d.messages import CameraInfo
from services.camera.calibration import camera_info, to_intrinsics
from services.camera.source import SourceFrame

COLOUR, DEPTH = "colour", "depth"  # inputs of the synchronisation


class Oak(SdkCamera):
    """An OAK with stereo, depth aligned to colour on the camera; colour without distortion."""

    name = "oak"
    module = "depthai"
    usb = re.compile(r"^03e7:")

    @classmethod
    def list_devices(cls) -> list[tuple[str, str]]:
        """Return the name and the identifier of each camera on USB or in the network."""
        found = cls.sdk().Device.getAllConnectedDevices()
        return [(f"OAK ({one.name})", one.getDeviceId()) for one in found]

    def open_device(self, serial: str) -> "OakDevice":
        """Start the pipeline on the camera."""
        dai = self.sdk()
        device = dai.Device(dai.DeviceInfo(serial))
        pipeline = dai.Pipeline(device)
        queue = self._join_nodes(dai, device, pipeline)
        matrix = device.readCalibration().getCameraIntrinsics(
            dai.CameraBoardSocket.CAM_A, self.options.width, self.options.height
        )
        size = self.options.height, self.options.width
        pipeline.start()
        return OakDevice(dai, pipeline, queue, camera_info(to_intrinsics(np.asarray(matrix)), size))

    def _join_nodes(self, dai: Any, device: Any, pipeline: Any) -> Any:
        """Connect colour, stereo and synchronisation, and return the queue of pairs."""
        fps = self.options.fps
        sockets = dai.CameraBoardSocket
        colour, left, right = (
            pipeline.create(dai.node.Camera).build(socket)
            for socket in (sockets.CAM_A, sockets.CAM_B, sockets.CAM_C)
        )
        size, rgb = (self.options.width, self.options.height), dai.ImgFrame.Type.RGB888i
        image = colour.requestOutput(size, type=rgb, fps=fps, enableUndistortion=True)
        stereo, sync = (pipeline.create(node) for node in (dai.node.StereoDepth, dai.node.Sync))
        left.requestOutput((640, 400), fps=fps).link(stereo.left)
        right.requestOutput((640, 400), fps=fps).link(stereo.right)
        depth = stereo.depth
        if device.getPlatform() == dai.Platform.RVC4:
            align = pipeline.create(dai.node.ImageAlign)
            depth.link(align.input)
            image.link(align.inputAlignTo)
            depth = align.outputAligned
        else:
            image.link(stereo.inputAlignTo)
        sync.setSyncThreshold(timedelta(seconds=0.5 / fps))
        image.link(sync.inputs[COLOUR])
        depth.link(sync.inputs[DEPTH])
        return sync.out.createOutputQueue(maxSize=2, blocking=False)


class OakDevice:
    """An open OAK."""

    def __init__(self, dai: Any, pipeline: Any, queue: Any, info: CameraInfo) -> None:
        self._dai, self._pipeline, self._queue, self.info = dai, pipeline, queue, info

    def read(self) -> SourceFrame | None:
        """Return the next pair; None if none comes in time."""
        pair = self._queue.get(timedelta(milliseconds=WAIT_MS))
        if pair is None:
            return None
        colour, depth = pair[COLOUR], pair[DEPTH]
        # stamps on the host's steady clock
        age = self._dai.Clock.now() - colour.getTimestamp()
        return SourceFrame(
            rgb=np.array(colour.getFrame()),
            depth_mm=np.array(depth.getFrame(), np.uint16),
            stamp_ns=time.time_ns() - age // timedelta(microseconds=1) * 1000,
        )

    def close(self) -> None:
        """Stop the camera."""
        self._pipeline.stop()
        self._pipeline.getDefaultDevice().close()
