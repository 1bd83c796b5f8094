"""Nodes and viewers: sequences of valid messages with changed values."""

import contextlib
import math
import struct
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgpack
import msgspec
import rerun

from common.runtime.node import Node
from deploy.anonymise.colourless import without_colour
from deploy.viewers.foxglove_messages import FoxgloveConverter
from deploy.viewers.rerun_log import RerunLog
from people4d.codec import decode, encode
from people4d.errors import DecodeError, People4dError
from people4d.messages import Message
from people4d.topics import BY_MESSAGE
from services.dashboard.config import DashboardConfig
from services.dashboard.hub import Demand
from services.dashboard.node import DashboardNode
from services.events.config import EventsConfig
from services.events.node import EventsNode
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.node import GtBridgeNode
from services.predictor.config import PredictorConfig
from services.predictor.node import PredictorNode
from services.reid.build import build as build_reid
from services.reid.config import ReidConfig
from services.ros2_bridge.config import Ros2BridgeConfig
from services.ros2_bridge.node import Ros2BridgeNode
from services.skeleton.config import SkeletonConfig
from services.skeleton.node import SkeletonNode
from services.target.config import TargetConfig
from services.target.node import TargetNode
from services.tracker.build import build as build_tracker
from services.tracker.config import TrackerConfig
from tests.contract.examples import FULL, SPARSE
from tests.fuzz.target import Target
from tests.ros2_bridge.memory import MemoryTransport

STEP = 14  # bytes of an input for each message
MESSAGES_MAX = 24  # in one input
FRAME_NS = 66_000_000
UNCHANGED = 255  # choice of a value
VALUES: tuple[Any, ...] = (
    *(None, True, 0, 1, -1, 2**31, 2**53, 2**62, -(2**62), "", "front", "x" * 65, "\x1b[2J"),
    *(0.0, -0.0, 1e-9, 1e3, 1e6, -1e6, 1e12, math.nan, math.inf, [], {}, b"", b"\x00" * 24),
)
Path_ = tuple[Any, ...]


def leaves(fields: Any, path: Path_ = ()) -> Iterator[Path_]:
    """Yield the paths of all values."""
    if isinstance(fields, dict) and fields:
        for name, value in fields.items():
            yield from leaves(value, (*path, name))
    elif isinstance(fields, list) and fields:
        yield path
        for index, value in enumerate(fields):
            yield from leaves(value, (*path, index))
    else:
        yield path


EXAMPLES: tuple[dict[str, Any], ...] = tuple(
    msgpack.unpackb(encode(message)) for message in (*FULL, *SPARSE)
)
LEAVES = tuple(
    [path for path in leaves(fields) if path not in (("message",), ("version",))]
    for fields in EXAMPLES
)


def messages(data: bytes) -> Iterator[Message]:
    """Yield the messages of an input that are valid.

    Of each step the bytes choose an example, one of its values, what this becomes, and how many
    frames later it is.
    """
    for number, start in enumerate(range(0, min(len(data), STEP * MESSAGES_MAX), STEP)):
        chosen, leaf, kind, later, bits = struct.unpack("<BHBBxQ", data[start:][:STEP].ljust(STEP))
        index = chosen % len(EXAMPLES)
        fields = msgpack.unpackb(msgpack.packb(EXAMPLES[index]))
        fields["stamp_ns"] += (number + later) * FRAME_NS
        fields["sequence"] += number
        if kind != UNCHANGED:
            change(fields, LEAVES[index][leaf % len(LEAVES[index])], kind, bits)
        with contextlib.suppress(DecodeError, OverflowError):
            yield decode(msgpack.packb(fields))


def change(fields: dict[str, Any], path: Path_, kind: int, bits: int) -> None:
    """Change the value at a path: to one of VALUES, or to a number of 64 bits."""
    inner: Any = fields
    for name in path[:-1]:
        inner = inner[name]
    value, name = inner[path[-1]], path[-1]
    raw = bits.to_bytes(8, "little")
    if isinstance(value, bytes) and len(value) >= 8 and kind % 4:
        start = kind // 4 * 8 % (len(value) // 8 * 8)  # one number of an array
        inner[name] = value[:start] + raw + value[start + 8 :]
    elif isinstance(value, list) and value and kind % 2:
        inner[name] = value * (bits % 50) if kind % 4 == 1 else value[: bits % len(value)]
    elif isinstance(value, int) and kind >= len(VALUES):
        inner[name] = value + int.from_bytes(raw, "little", signed=True) if kind % 2 else bits % 99
    elif isinstance(value, float) and kind >= len(VALUES):
        inner[name] = struct.unpack("<d", raw)[0] if kind % 2 else (bits % 2001 - 1000) / 50
    else:
        inner[name] = VALUES[kind % len(VALUES)]


def seeds(_: Path) -> Sequence[bytes]:
    """Return inputs of unchanged and changed messages of each type."""
    plain = struct.pack("<BHBBxQ", 0, 0, UNCHANGED, 0, 0)
    every = b"".join(bytes([index]) + plain[1:] for index in range(len(EXAMPLES)))
    longest = STEP * MESSAGES_MAX
    found = [every[start : start + longest] for start in range(0, len(every), longest)]
    for index in range(len(EXAMPLES)):
        steps = [struct.pack("<BHBBxQ", index, 7 * k, 9 * k + 3, k % 2, 5 * k) for k in range(12)]
        found.append(b"".join(steps))
    return found


def node_target(name: str, make: Callable[[], Node]) -> Target:
    """Return the target of a node: a new one for each input, which raises nothing."""

    def read(data: bytes, _: Path) -> None:
        node = make()
        kinds = {*node.inputs, *node.inputs_on_demand}
        now_ns = 10**9
        try:
            for message in messages(data):
                if type(message) not in kinds:
                    continue
                now_ns += FRAME_NS
                if not node.admits(BY_MESSAGE[type(message)], encode(message)):
                    continue
                for output in (*node.handle(message, now_ns), *node.tick(now_ns)):
                    decode(encode(output))
            for output in (*node.tick(now_ns + 10**9), *node.flush(now_ns + 10**9)):
                decode(encode(output))
            msgspec.json.encode(node.status())
        except People4dError as error:
            raise AssertionError(f"a node raised {error!r}") from error
        finally:
            node.close()

    return Target(f"messages to {name}", read, seeds, max_bytes=STEP * MESSAGES_MAX)


def viewer_target(name: str, make: Callable[[], Callable[[Message], object]]) -> Target:
    """Return the target of what shows messages; it may refuse an image."""

    def read(data: bytes, _: Path) -> None:
        show = make()
        for message in messages(data):
            with contextlib.suppress(DecodeError):
                show(message)

    return Target(f"messages to {name}", read, seeds, max_bytes=STEP * MESSAGES_MAX)


def _dashboard() -> Node:
    node = DashboardNode(DashboardConfig())
    node._take_demand(Demand(viewers=1, images=True, cloud=True))
    node.tick(0)
    return node


def _foxglove() -> Callable[[Message], object]:
    converter = FoxgloveConverter(images=True)
    return lambda message: list(converter.convert(message, message.stamp_ns))


def _rerun() -> Callable[[Message], object]:
    if not STREAM:  # a fork would lose its threads
        STREAM.append(rerun.RecordingStream("fuzz"))
        STREAM[0].send_blueprint = lambda _: None  # each leaves two threads of Rerun
        STREAM.append(STREAM[0].memory_recording())
    stream, memory = STREAM
    memory.drain_as_bytes()
    log = RerunLog(stream)
    return lambda message: log.write(message, message.stamp_ns)


STREAM: list[Any] = []
EVERYTHING = Ros2BridgeConfig(
    publish=("people", "markers", "humans", "diagnostics", "tf", "odometry"), reader_frame="map"
)

TARGETS = (
    *(
        node_target(
            f"the tracker ({method})", partial(build_tracker, TrackerConfig(tracker=method))
        )
        for method in ("strongsort3d", "image_sort")
    ),
    node_target("reid", partial(build_reid, ReidConfig(embedder="histogram"))),
    node_target("the predictor", lambda: PredictorNode(PredictorConfig())),
    node_target("skeleton", lambda: SkeletonNode(SkeletonConfig())),
    node_target("target", lambda: TargetNode(TargetConfig())),
    node_target("events", lambda: EventsNode(EventsConfig())),
    node_target("the dashboard", _dashboard),
    node_target("ros2_bridge", lambda: Ros2BridgeNode(EVERYTHING, MemoryTransport())),
    node_target("gt_bridge", lambda: GtBridgeNode((), GtBridgeConfig())),
    viewer_target("Foxglove", _foxglove),
    viewer_target("Rerun", _rerun),
    viewer_target("a recording without colour", lambda: without_colour),
)
