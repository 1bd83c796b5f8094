"""A camera with an SDK, with a device of the test: opening, failures, reconnection."""

import re
import sys
import threading
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from cameras.sdk import SdkCamera
from common import extras
from deploy.cli import app
from people4d.errors import ConfigError, People4dError
from services.camera.calibration import Intrinsics, camera_info
from services.camera.config import CameraConfig
from services.camera.source import SourceFrame
from services.camera.sources import camera_class, check_source, kind_of, named_cameras, open_source
from tests import ROOT
from tests.camera.memory import SIZE, capture
from tests.camera.test_node import player

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
NAMES = PROJECT["entry-points"]["people4d.cameras"]


class TestDevice:
    """Gives a list of frames; an exception is raised, a function called."""

    __test__ = False

    def __init__(self, items: list[Any]) -> None:
        self.info = camera_info(Intrinsics(fx=10, fy=10, cx=4, cy=3), SIZE)
        self._items = iter(items)
        self.closed = False

    def read(self) -> SourceFrame | None:
        item = next(self._items, None)
        if isinstance(item, Exception):
            raise item
        return item() if callable(item) else item

    def close(self) -> None:
        self.closed = True


class TestCamera(SdkCamera):
    """A camera whose SDK is the module json; each opening takes the next list of items."""

    __test__ = False
    name, module, usb = "test", "json", re.compile("^0000:")
    serials: tuple[str, ...] = ("A1", "B2")

    def __init__(self, *openings: list[Any] | Exception, **options: Any) -> None:
        super().__init__(**options)
        self._openings = iter(openings)
        self.opened: list[tuple[str, TestDevice]] = []

    @classmethod
    def list_devices(cls) -> list[tuple[str, str]]:
        return [("Test", serial) for serial in cls.serials]

    def open_device(self, serial: str) -> TestDevice:
        items = next(self._openings)
        if isinstance(items, Exception):
            raise items
        self.opened.append((serial, TestDevice(items)))
        return self.opened[-1][1]


@pytest.fixture(autouse=True)
def sdk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(extras.MODULES, "test", ("json",))


def failure(camera: SdkCamera) -> str:
    with pytest.raises(People4dError) as caught:
        list(camera)
    return str(caught.value)


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (RuntimeError("VIDIOC_S_FMT failed: Device or resource busy"), "Close the other program"),
        (RuntimeError("X_LINK_DEVICE_ALREADY_IN_USE"), "Close the other program"),
        (RuntimeError("open usb interface: 0, error: RS2_USB_STATUS_ACCESS"), "udev rules"),
        (RuntimeError("Insufficient permissions to communicate with X_LINK"), "udev rules"),
        (RuntimeError("Couldn't resolve requests"), "Choose options.width, height and fps"),
        (ImportError("libusb-1.0.so.0: cannot open shared object file"), "apt install libusb-1.0"),
        (OSError("nothing known"), "See: people4d cameras"),
    ],
)
def test_error_of_an_sdk_is_one_sentence_with_the_remedy(error: Exception, sentence: str) -> None:
    text = failure(TestCamera(error))
    assert text.startswith(f"camera test: {error}. ")
    assert sentence in text


def test_camera_is_chosen_by_its_serial_number() -> None:
    for options, serial in (({}, "A1"), ({"serial": "B2"}, "B2")):
        camera = TestCamera([capture(1)], **options)
        assert "sends no images for 1 s. Check its cable" in failure(camera)
        assert [(name, device.closed) for name, device in camera.opened] == [(serial, True)]
    assert failure(TestCamera(serial="C3")) == (
        "no camera test has serial C3, but A1, B2. See: people4d cameras"
    )


def test_unplugged_camera_is_opened_again_and_calibrated_anew() -> None:
    unplugged = RuntimeError("device disconnected")
    camera = TestCamera([capture(1), unplugged], RuntimeError("No device"), [capture(2)] * 9)
    with player(CameraConfig(), camera) as p:
        p.tick()
        p.until(lambda: "device disconnected" in p.node.status().reason)
        assert p.node.status().state == "degraded"
        p.until(lambda: "No device" in p.node.status().reason)
        p.until(lambda: len(p.frames()) >= 2)
        assert p.node.status().counters["source_errors"] >= 2
    assert all(device.closed for _, device in camera.opened)


@pytest.mark.parametrize(
    ("frame", "fault"),
    [
        (capture(1, size=(3, 8)), r"rgb is uint8 \(3, 8, 3\), expected uint8 \(6, 8, 3\)"),
        (capture(1, depth_size=(3, 4)), r"depth_mm is uint16 \(3, 4\), expected uint16 \(6, 8\)"),
        (
            SourceFrame(np.zeros((*SIZE, 3), np.uint8), np.full(SIZE, 1.5), 1),
            r"depth_mm is float64 \(6, 8\), expected uint16",
        ),
    ],
)
def test_frame_of_another_size_or_type_is_named_with_the_expected(
    frame: SourceFrame, fault: str
) -> None:
    read, release = threading.Event(), threading.Event()

    def pause() -> None:
        read.set()
        release.wait(10)

    with player(CameraConfig(), TestCamera([capture(0), frame, pause])) as p:
        p.tick()
        assert read.wait(10)
        assert re.search(fault, p.node.status().reason)
        release.set()


def test_option_that_is_unknown_or_wrong_is_named() -> None:
    with pytest.raises(ConfigError, match="Options are serial, width, height, fps"):
        TestCamera(fsp=30)
    with pytest.raises(ConfigError, match="fps"):
        TestCamera(fps=0)


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[dict[str, str]], None]:
    """Install a distribution with cameras."""

    def install(cameras: dict[str, str]) -> None:
        folder = tmp_path / "some_cameras-1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(
            "Metadata-Version: 2.1\nName: some-cameras\nVersion: 1.0\n"
        )
        lines = "".join(f"{name} = {value}\n" for name, value in cameras.items())
        (folder / "entry_points.txt").write_text(f"[people4d.cameras]\n{lines}")
        monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])

    return install


def test_camera_of_another_distribution_is_a_source_by_its_name(
    installed: Callable[[dict[str, str]], None],
) -> None:
    installed({"tested": f"{__name__}:TestCamera"})
    assert kind_of("tested") == "camera"
    source = open_source("tested", {"serial": "B2"})
    assert isinstance(source, TestCamera)
    check_source(CameraConfig(source="tested"))
    with pytest.raises(ConfigError, match="fsp"):
        check_source(CameraConfig(source="tested", options={"fsp": 3}))
    result = CliRunner().invoke(app, ["cameras"])
    assert result.exit_code == 0
    assert re.search(r"tested +Test +A1 +none", result.output)


@pytest.mark.parametrize("name", NAMES)
def test_shipped_camera_is_a_source_without_its_sdk(
    name: str, installed: Callable[[dict[str, str]], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    installed(NAMES)
    assert named_cameras().keys() >= NAMES.keys()
    kind = camera_class(name)
    assert issubclass(kind, SdkCamera)
    assert not kind.__abstractmethods__
    assert (kind.name, extras.MODULES[name]) == (name, (kind.module,))
    assert name in PROJECT["optional-dependencies"]
    monkeypatch.setitem(extras.MODULES, name, ("absent_sdk",))
    with pytest.raises(ConfigError, match=rf"absent_sdk.*people4d-robot\[{name}\]"):
        check_source(CameraConfig(source=name))
