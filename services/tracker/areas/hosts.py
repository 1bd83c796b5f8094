"""Cameras of an area on several hosts, each with a router and a robot name of its own."""

import time
from collections.abc import Sequence
from functools import partial

from common.text import named
from common.transport.other_robot import topic_of
from people4d.errors import ConfigError, DecodeError
from people4d.messages import (
    CameraInfo,
    Detections,
    Embeddings,
    Message,
    MovingTransform,
    Odometry,
    StaticTransform,
)
from people4d.topics import BY_MESSAGE, ForeignTopic

KINDS = (Detections, Embeddings, CameraInfo, StaticTransform, MovingTransform, Odometry)
FORGOTTEN_S = 10.0  # minimum silence before another host may use a camera name [s]
NAMES_MAX = 1024  # maximum number of stored names of cameras and frames
SILENT_S = 3.0  # maximum time without detections of an active host [s]


class CameraHosts:
    """Topics of cameras on other hosts; each name belongs to one host.

    Args:
        names: Robot names of the hosts.

    Raises:
        ConfigError: A host is named twice.
    """

    def __init__(self, names: Sequence[str]) -> None:
        if len(set(names)) < len(names):
            raise ConfigError("tracker.area.hosts: expected each name once, got one twice")
        # Time of the last detections, by host
        self._heard_s = dict.fromkeys(names, time.monotonic())
        # Host and time of the last message, by camera or frame
        self._owners: dict[str, tuple[str, float]] = {}

    def topics(self, own: str) -> list[ForeignTopic]:
        """Return the topics to listen to.

        Args:
            own: Name of this robot, whose cameras need no additional topics.

        Raises:
            ConfigError: This robot is one of the hosts.
        """
        if own in self._heard_s:
            raise ConfigError(
                f"the cameras of {own} are tracked twice",
                "Leave its own name out of tracker.area.hosts; --robot names it.",
            )
        return [
            topic_of(host, kind, partial(self._accept, host))
            for host in self._heard_s
            for kind in KINDS
        ]

    def reasons(self) -> list[str]:
        """Return a status message that names silent hosts."""
        now_s = time.monotonic()
        silent = [host for host, s in self._heard_s.items() if now_s - s > SILENT_S]
        if not silent:
            return []
        return [f"no detections arrive from {named('host', silent)}: its cameras are missing"]

    def _accept(self, host: str, message: Message) -> Message:
        """Return a message of a host.

        Raises:
            DecodeError: Another host has the camera or frame.
        """
        name, now_s = BY_MESSAGE[type(message)].name, time.monotonic()
        if isinstance(message, StaticTransform | MovingTransform):
            what, owned = "frame", message.child
        elif isinstance(message, Odometry):
            what, owned = "frame", message.child_frame_id
        else:
            assert isinstance(message, Detections | Embeddings | CameraInfo)
            what, owned = "camera", message.camera
        owner, last_s = self._owners.get(f"{what} {owned}", (host, now_s))
        if owner != host and now_s - last_s < FORGOTTEN_S:
            raise DecodeError(f"{name}: hosts {owner} and {host} both have a {what} {owned}")
        if len(self._owners) < NAMES_MAX or f"{what} {owned}" in self._owners:
            self._owners[f"{what} {owned}"] = host, now_s
        if isinstance(message, Detections):
            self._heard_s[host] = now_s
        return message
