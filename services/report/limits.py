"""Limits of a run: reasons of degraded services, and unused inputs."""

import re
from collections import Counter

import numpy as np

from common.geometry.transforms import LINK_FROM_OPTICAL
from people4d.messages import (
    Health,
    Message,
    MovingTransform,
    Odometry,
    RgbdFrame,
    StaticTransform,
    Truth,
)

FLOWS_NS = 1_000_000_000  # [ns] maximum age of the last frame at a heartbeat of the run
MIN_BEATS = 4  # minimum number of heartbeats with a reason; they come twice a second
MAX_REASONS = 100  # maximum number of reasons of all services
ENDED_NS = 1_000_000_000  # [ns] time from the last truth to the last frame if truth ended
NUMBER = re.compile(r"[\d.]+")
WAITS = re.compile(r"no [\w ,]+ for \d+ s")  # pattern of reasons that another service explains


class RunLimits:
    """Collects reasons of degraded services while frames arrive, in bounded memory.

    Args:
        truth: Configured source of ground truth; empty: none.
    """

    def __init__(self, truth: str = "") -> None:
        self._truth = truth
        self._frame_ns: int | None = None  # arrival of the last frame
        self._beats: Counter[tuple[str, str]] = (
            Counter()
        )  # heartbeats by instance and reason without numbers
        # Last reason with its numbers, by instance and reason without numbers
        self._reasons: dict[tuple[str, str], str] = {}
        self._ends_ns: dict[type[Message], int] = {}  # last stamps by type
        self._odometry_used = False
        self._mounts: set[bool] = set()  # kinds of received mounts: False is the default mount

    def add_message(self, message: Message, now_ns: int) -> None:
        """Add a message that arrived at this monotonic time."""
        if isinstance(message, RgbdFrame):
            self._frame_ns = now_ns
            self._ends_ns[RgbdFrame] = message.stamp_ns
        elif isinstance(message, Health):
            self._add_health(message, now_ns)
        elif isinstance(message, StaticTransform):
            self._mounts.add(not np.array_equal(message.matrix, LINK_FROM_OPTICAL))
        elif isinstance(message, MovingTransform):
            self._mounts.add(True)
        elif isinstance(message, Truth | Odometry):
            self._ends_ns[type(message)] = message.stamp_ns

    def _add_health(self, health: Health, now_ns: int) -> None:
        if health.service == "tracker":
            self._odometry_used = health.counters.get("received_odometry", 0) > 0
        if self._frame_ns is None or now_ns - self._frame_ns > FLOWS_NS:
            return
        for reason in health.reason.split("; ") if health.state == "degraded" else ():
            key = health.instance, NUMBER.sub("", reason)
            if not WAITS.fullmatch(reason) and (
                key in self._beats or len(self._beats) < MAX_REASONS
            ):
                self._beats[key] += 1
                self._reasons[key] = reason

    def degraded(self, is_scored: bool) -> tuple[str, ...]:
        """Return the limits of the run, one sentence each; `is_scored`: tracks matched truth."""
        found = [f"{k[0]}: {self._reasons[k]}" for k, n in self._beats.items() if n >= MIN_BEATS]
        if self._truth and Truth not in self._ends_ns:
            found.append(f"truth: none arrived from {self._truth}")
        if Truth in self._ends_ns and RgbdFrame in self._ends_ns:
            early_ns = self._ends_ns[RgbdFrame] - self._ends_ns[Truth]
            if not is_scored:
                found.append("truth: does not cover the time of the frames")
            elif early_ns > ENDED_NS:
                found.append(f"truth: ended {early_ns / 1e9:.1f} s before the frames")
        return tuple(sorted(found))

    def unused(self) -> tuple[str, ...]:
        """Return unused inputs: odometry, the camera's mount, truth."""
        parts = []
        if Odometry not in self._ends_ns:
            parts.append("odometry (none received: the base stands)")
        elif not self._odometry_used:
            parts.append("odometry (the tracker takes none)")
        if True not in self._mounts:
            parts.append("mount (none given: the camera is the origin of the map)")
        if Truth not in self._ends_ns:
            parts.append("truth (none received)")
        return tuple(parts)
