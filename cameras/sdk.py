"""Opening, reading and failures of a camera with an SDK."""

import importlib
import re
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any, ClassVar, Protocol

from cameras.usb import usb_devices
from common.config import Config
from common.extras import need
from people4d.errors import People4dError, SourceError
from people4d.messages import CameraInfo
from people4d.messages.base import ImageSide, PositiveInt
from services.camera.source import ConnectedCamera, Source, SourceFrame, SourceSetup
from services.camera.sources import read_options

WAIT_MS = 1000  # maximum time between two pairs of images [ms]
# Remedy by the words of an SDK's error; the first match counts
REMEDIES = {
    r"busy|in use|in_use|claim": "Close the other program that holds it: a viewer, a ROS driver.",
    r"permission|access|denied|LIBUSB_ERROR_ACCESS": "Install the udev rules of its SDK, then "
    "plug it in again.",
    r"resolve|profile|not support|unsupported|invalid (size|res)": "Choose options.width, height "
    "and fps of a mode that both its sensors have; over USB 2 there are fewer.",
    r"libusb|shared object": "Run: apt install libusb-1.0-0",
}


class SdkOptions(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Options of a camera with an SDK."""

    serial: str = ""  # serial number; empty: the only camera, or the first one
    width: ImageSide = 640  # [px] width of colour and of aligned depth
    height: ImageSide = 480  # [px] height of colour and of aligned depth
    fps: PositiveInt = 30  # [Hz] rate of frames


class Device(Protocol):
    """An open camera."""

    info: CameraInfo  # calibration of colour

    def read(self) -> SourceFrame | None:
        """Return the next pair, depth aligned to colour; None if it takes longer than WAIT_MS."""

    def close(self) -> None:
        """Release the camera."""


class SdkCamera(Source):
    """A camera that is opened on reading, and reopened after a failure.

    Its SDK is imported at its first use. ConfigError if the SDK is not installed, or an option is
    unknown or wrong.
    """

    live = True
    calibrates_late = True
    name: ClassVar[str]  # name of the source, and of the extra that installs the SDK
    module: ClassVar[str]  # module of the SDK, as in common.extras
    usb: ClassVar[re.Pattern[str]]  # vendor, product and name of the USB devices

    def __init__(self, **options: Any) -> None:
        self.options = read_options(SdkOptions, options)
        need(f"camera {self.name}", self.name)

    @classmethod
    def sdk(cls) -> Any:
        """Import the SDK; ImportError if a library of the system is missing."""
        return importlib.import_module(cls.module)

    @classmethod
    @abstractmethod
    def list_devices(cls) -> list[tuple[str, str]]:
        """Return the model and the serial number of each camera that the SDK finds."""

    @abstractmethod
    def open_device(self, serial: str) -> Device:
        """Open a camera and start its streams; any error of the SDK may be raised."""

    @classmethod
    def connected(cls) -> Sequence[ConnectedCamera]:
        """Return the cameras on USB, and those that only the SDK finds, with their problems."""
        problem, listed = "", list[tuple[str, str]]()
        try:
            need(f"camera {cls.name}", cls.name)
            listed = cls.list_devices()
        except Exception as error:  # an SDK may raise any exception
            problem = str(explained(cls.name, error))
        on_usb = [one for one in usb_devices() if cls.usb.search(one.label)]
        if problem or len(on_usb) > len(listed):
            unusable = problem or f"{cls.module} does not find it. Plug it in again."
            return [ConnectedCamera(one.name, "", one.problem or unusable) for one in on_usb]
        faults = {one.problem for one in on_usb}
        fault = faults.pop() if len(faults) == 1 else ""
        return [ConnectedCamera(model, serial, fault) for model, serial in listed]

    def __iter__(self) -> Iterator[SourceFrame | SourceSetup]:
        """Yield the calibration, then frames until the camera fails."""
        try:
            device = self.open_device(self._serial())
            try:
                frame = self._read(device)
                yield SourceSetup(device.info, (), False, frame.stamp_ns)
                while True:
                    yield frame
                    frame = self._read(device)
            finally:
                with suppress(Exception):  # the camera may be unplugged
                    device.close()
        except Exception as error:  # an SDK may raise any exception
            raise explained(self.name, error) from error

    def _read(self, device: Device) -> SourceFrame:
        frame = device.read()
        if frame is None:
            problem = f"camera {self.name} sends no images for {WAIT_MS / 1000:g} s"
            raise SourceError(problem, "Check its cable; it is opened again.")
        return frame

    def _serial(self) -> str:
        serials, wanted = [serial for _, serial in self.list_devices()], self.options.serial
        if wanted in serials or (serials and not wanted):
            return wanted or serials[0]
        problem = f"no camera {self.name} is plugged in"
        if serials:
            problem = f"no camera {self.name} has serial {wanted}, but {', '.join(serials)}"
        faults = [one.problem for one in self.connected() if one.problem]
        raise SourceError(problem, faults[0] if faults else "See: people4d cameras")


def explained(name: str, error: Exception) -> People4dError:
    """Return an error of an SDK as one sentence with the remedy; our own errors have one."""
    if isinstance(error, People4dError):
        return error
    text = " ".join(str(error).split()) or type(error).__name__
    remedies = (remedy for words, remedy in REMEDIES.items() if re.search(words, text, re.I))
    return SourceError(f"camera {name}: {text:.300}", next(remedies, "See: people4d cameras"))
