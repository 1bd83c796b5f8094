"""Devices on USB as Linux lists them, in folders of the test."""

from pathlib import Path

import pytest

from cameras import sdk
from cameras.orbbec import Orbbec
from cameras.realsense import RealSense
from cameras.usb import UsbDevice, usb_devices
from common import extras


@pytest.fixture
def devices(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("sys", "dev/001"):
        (tmp_path / name).mkdir(parents=True)
    found = lambda: usb_devices(tmp_path / "sys", tmp_path / "dev")  # noqa: E731
    monkeypatch.setattr(sdk, "usb_devices", found)
    return tmp_path


def plug(folder: Path, number: int, device: str, name: str, speed: str, mode: int = 0o600) -> Path:
    """Add a device, "vendor:product", and its node."""
    vendor, product = device.split(":")
    listed = folder / "sys" / f"1-{number}"
    listed.mkdir()
    values = {"idVendor": vendor, "idProduct": product, "product": name, "speed": speed}
    for file, text in {**values, "busnum": "1", "devnum": str(number)}.items():
        (listed / file).write_text(text + "\n")
    node = folder / "dev/001" / f"{number:03}"
    if mode:
        node.touch(mode)
    return node


def listed(folder: Path) -> list[UsbDevice]:
    return list(usb_devices(folder / "sys", folder / "dev"))


def test_device_on_usb_3_has_no_problem(devices: Path) -> None:
    plug(devices, 2, "2bc5:0800", "Gemini 335", "5000")
    (devices / "sys" / "1-2:1.0").mkdir()  # an interface, which has no vendor
    assert listed(devices) == [UsbDevice("Gemini 335", "2bc5:0800 Gemini 335", "")]


def test_device_on_usb_2_is_named_with_the_remedy(devices: Path) -> None:
    plug(devices, 2, "8086:0b07", "Intel(R) RealSense(TM) Depth Camera 435", "480")
    plug(devices, 3, "03e7:2485", "Movidius MyriadX", "480")  # changes to USB 3 when opened
    slow, starting = listed(devices)
    assert slow.problem.startswith("it is on USB 2. Use a port and a cable of USB 3")
    assert starting.problem == ""


def test_device_without_permission_is_named_with_the_remedy(devices: Path) -> None:
    node = plug(devices, 2, "2bc5:0800", "Gemini 335", "480", mode=0)  # root may use any node
    (only,) = listed(devices)
    assert only.problem.startswith(f"no permission for {node}. Install the udev rules")


def test_camera_without_its_sdk_is_listed_with_the_command(
    devices: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plug(devices, 2, "8086:0b07", "Intel(R) RealSense(TM) Depth Camera 435", "5000")
    plug(devices, 3, "8086:0aaa", "Bluetooth", "12")
    plug(devices, 4, "2bc5:0800", "Gemini 335", "5000")
    monkeypatch.setitem(extras.MODULES, "realsense", ("absent_sdk",))
    (camera,) = RealSense.connected()
    assert camera.model == "Intel(R) RealSense(TM) Depth Camera 435"
    assert "needs absent_sdk, which is not installed. Install it" in camera.problem
    assert "people4d-robot[realsense]" in camera.problem
    monkeypatch.setitem(extras.MODULES, "orbbec", ("json",))
    monkeypatch.setattr(Orbbec, "list_devices", lambda: [("Gemini 335", "CP1")])
    assert [(one.serial, one.problem) for one in Orbbec.connected()] == [("CP1", "")]
