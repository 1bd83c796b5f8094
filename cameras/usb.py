"""Devices on USB, as Linux lists them, and the reasons why a camera cannot be used."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

DEVICES = Path("/sys/bus/usb/devices")
NODES = Path("/dev/bus/usb")
SUPER_MBPS = 5000.0  # speed of USB 3 [Mbit/s]
BOOTLOADERS = ("03e7:2485",)  # vendor and product of a camera that switches to USB 3 on opening


@dataclass(frozen=True)
class UsbDevice:
    """A device on USB."""

    name: str  # name of the product
    label: str  # "vendor:product name"
    problem: str  # reason why a camera cannot be used, with the remedy; empty without one


def usb_devices(devices: Path = DEVICES, nodes: Path = NODES) -> Iterator[UsbDevice]:
    """Yield the devices on USB; none on another system than Linux."""
    for folder in sorted(devices.glob("*")):
        vendor, product = (_read(folder / name) for name in ("idVendor", "idProduct"))
        if vendor:
            name = _read(folder / "product") or f"{vendor}:{product}"
            problem = _problem(folder, nodes, f"{vendor}:{product}" in BOOTLOADERS)
            yield UsbDevice(name, f"{vendor}:{product} {name}", problem)


def _problem(folder: Path, nodes: Path, starts: bool) -> str:
    bus, number = (_read(folder / name) for name in ("busnum", "devnum"))
    node = nodes / f"{int(bus or 0):03}" / f"{int(number or 0):03}"
    if not os.access(node, os.R_OK | os.W_OK):
        return (
            f"no permission for {node}. Install the udev rules of its SDK, then plug it in again."
        )
    if float(_read(folder / "speed") or SUPER_MBPS) < SUPER_MBPS and not starts:
        return "it is on USB 2. Use a port and a cable of USB 3, or a low resolution and rate."
    return ""


def _read(file: Path) -> str:
    try:
        return file.read_text("utf-8", "replace").strip()
    except OSError:
        return ""
