"""Nodes of all services, built from their configurations."""

import importlib
import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np

from common.ros2.config import Ros2Config
from common.runtime.node import Node
from people4d.messages import Odometry
from services.camera.calibration import Intrinsics, camera_info
from services.camera.source import Source, SourceFrame
from services.ros2_bridge.config import Output

SIZE = (48, 64)


class BlankSource(Source):
    """A plug-in camera of endless black images."""

    def __init__(self) -> None:
        self.info = camera_info(Intrinsics(fx=60, fy=60, cx=32, cy=24), SIZE)

    def __iter__(self) -> Iterator[SourceFrame | Odometry]:
        rgb, depth_mm = np.zeros((*SIZE, 3), np.uint8), np.zeros(SIZE, np.uint16)
        for number in itertools.count():
            yield SourceFrame(rgb, depth_mm, number * 33_000_000)


SERVICES: dict[str, dict[str, Any]] = {
    "camera": {
        "source": f"{__name__}:BlankSource",
        "playback": "lockstep",
        "answer_timeout_s": 1000.0,
        "start_delay_s": 0.0,
    },
    "detector": {},
    "reid": {},
    "tracker": {},
    "tracker-sort3d": {"tracker": "sort3d"},
    "gait": {},
    "visual_odometry": {},
    "predictor": {},
    "skeleton": {},
    "target": {},
    "ros2_bridge": {
        "ros2": Ros2Config(transport="tests.ros2_bridge.memory:MemoryTransport"),
        "publish": get_args(Output),
        "reader_frame": "odom",
    },
    "gt_bridge": {},
    "dashboard": {},
    "events": {},
    "site": {"areas": ("area",)},
    "report": {"video": False, "sheet_frames": 2},
}


def node_of(name: str, folder: Path) -> Node:
    """Build a node."""
    service = name.partition("-")[0]
    build: Callable[[Any], Node] = importlib.import_module(f"services.{service}.build").build
    fields = SERVICES[name] | ({"folder": str(folder)} if service == "report" else {})
    return build(get_type_hints(build)["config"](**fields))
