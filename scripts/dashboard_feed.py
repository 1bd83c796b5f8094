"""Artificial messages of a pipeline, for the page of the dashboard.

People walk in circles before one camera. Boxes, keypoints, positions, depth and tracks are
consistent.
"""

import math
import threading
import time
from typing import Any

import cv2
import numpy as np

from common.geometry.transforms import apply, invert, project
from common.runtime.heartbeat import release
from common.transport.zenoh_bus import ZenohBus
from people4d.messages import (
    F32,
    F64,
    U8,
    U16,
    CameraInfo,
    Detection,
    Detections,
    Health,
    Message,
    MotionProbabilities,
    PersonPrediction,
    Predictions,
    RgbdFrame,
    Span,
    StaticTransform,
    Track,
    Tracks,
)

CAMERA, OPTICAL = "front", "front_optical_frame"
# Position 1.2 m above the ground, looking along +x
POSE = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1.2], [0, 0, 0, 1]])
SHIRTS = ((190, 70, 60), (60, 110, 190), (80, 150, 90), (200, 170, 70), (140, 90, 170))
FAR_M = 6.0
HORIZONS_S = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
SERVICES = ("camera", "detector", "reid", "tracker", "predictor", "router")
STAGES = (("camera.release", 1.0), ("detector.inference", 24.0), ("tracker.association", 2.0))
# COCO keypoints of a standing person facing x: forward, left, up [m] from the ground
BODY = np.array(
    [
        *((0.12, 0, 1.62), (0.1, 0.03, 1.66), (0.1, -0.03, 1.66), (0.02, 0.08, 1.63)),
        *((0.02, -0.08, 1.63), (0, 0.19, 1.42), (0, -0.19, 1.42), (0.02, 0.25, 1.14)),
        *((0.02, -0.25, 1.14), (0.1, 0.27, 0.9), (0.1, -0.27, 0.9), (0, 0.12, 0.93)),
        *((0, -0.12, 0.93), (0.02, 0.12, 0.5), (0.02, -0.12, 0.5), (0, 0.12, 0.08)),
        (0, -0.12, 0.08),
    ]
)
LIMBS = ((5, 7), (7, 9), (6, 8), (8, 10), (11, 13), (13, 15), (12, 14), (14, 16))


class Walker:
    """A person on a circle.

    Args:
        number: Identity.
    """

    def __init__(self, number: int) -> None:
        self.number = number
        self.centre = np.array([3.2 + 0.3 * (number % 3), 1.1 * ((number % 3) - 1)])
        self.radius_m, self.phase = 0.5 + 0.1 * (number % 2), 1.7 * number
        self.rate = (0.7 + 0.08 * number) * (1 if number % 2 else -1)  # [rad/s]

    def state(self, time_s: float) -> tuple[F64, F64, float]:
        """Return position and velocity on the ground [m, m/s], and yaw [rad]."""
        angle = self.phase + self.rate * time_s
        out = np.array([math.cos(angle), math.sin(angle)])
        velocity = self.radius_m * self.rate * np.array([-out[1], out[0]])
        return self.centre + self.radius_m * out, velocity, math.atan2(velocity[1], velocity[0])

    def joints(self, time_s: float) -> F64:
        """Return 17 keypoints in the map [m]."""
        position, _, yaw = self.state(time_s)
        body = BODY.copy()
        swing = 0.22 * math.sin(6 * time_s + self.phase)
        body[[9, 16], 0] += swing
        body[[10, 15], 0] -= swing
        c, s = math.cos(yaw), math.sin(yaw)
        rotated: F64 = body @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        rotated[:, :2] += position
        return rotated


class Feed:
    """Generator of the messages of frames.

    Args:
        people: Number of people.
        width: Width of the images [px].
    """

    def __init__(self, people: int = 3, width: int = 320) -> None:
        self.walkers = [Walker(number + 1) for number in range(people)]
        height = width * 3 // 4
        self.info = CameraInfo(
            stamp_ns=0,
            sequence=0,
            camera=CAMERA,
            frame_id=OPTICAL,
            width=width,
            height=height,
            fx=0.85 * width,
            fy=0.85 * width,
            cx=width / 2,
            cy=height / 2,
            max_depth_m=FAR_M,
        )
        self.pose = StaticTransform(
            stamp_ns=0, sequence=0, parent="map", child=OPTICAL, matrix=POSE
        )
        self._room = self._draw_room()

    def frame(self, sequence: int, stamp_ns: int, lockstep: bool = False) -> list[Message]:
        """Return the messages of one frame: frame, detections, tracks, predictions."""
        time_s = stamp_ns / 1e9
        optical_from_map = invert(POSE)
        states = [(walker, walker.state(time_s), walker.joints(time_s)) for walker in self.walkers]
        rgb, depth = self._room[0].copy(), self._room[1].copy()
        people, tracks = [], []
        states.sort(key=lambda one: -one[1][0][0])  # farthest first
        for index, (walker, (position, velocity, yaw), joints) in enumerate(states):
            points = apply(optical_from_map, joints)
            pixels = project(points, self.info)
            self._draw_person(rgb, depth, pixels, points[:, 2], SHIRTS[walker.number % len(SHIRTS)])
            people.append(self._detection(pixels, points))
            tracks.append(_track(walker.number, index, position, velocity, yaw, sequence))
        header: dict[str, Any] = {"stamp_ns": stamp_ns, "sequence": sequence}
        trace = _trace(time.time_ns())
        return [
            RgbdFrame(**header, camera=CAMERA, rgb=rgb, depth_mm=depth, lockstep=lockstep),
            Detections(
                **header,
                camera=CAMERA,
                frame_id=OPTICAL,
                model="made up",
                width=self.info.width,
                height=self.info.height,
                detections=tuple(people),
                trace=trace[:2],
            ),
            Tracks(
                **header,
                frame_id="map",
                tracker="made up",
                camera=CAMERA,
                tracks=tuple(tracks),
                trace=trace,
            ),
            self._predictions(time_s, header),
        ]

    def healths(self, sequence: int) -> list[Health]:
        """Return a heartbeat of every service."""
        rates = {"camera": "sent_frames", "detector": "sent_detections", "tracker": "sent_people"}
        return [
            Health(
                stamp_ns=time.time_ns(),
                sequence=sequence,
                service=service,
                instance=f"{service}-1",
                host="robot",
                pid=1,
                release=release(),
                state="ready",
                counters={rates[service]: sequence} if service in rates else {},
                gauges={"cpu_percent": 12.0, "memory_mb": 80.0}
                | ({f"{rates[service]}_hz": 10.0} if service in rates else {}),
            )
            for service in SERVICES
        ]

    def _draw_room(self) -> tuple[U8, U16]:
        """Return image and depth of floor and wall."""
        info = self.info
        rows = np.arange(info.height)[:, None]
        below = np.maximum(rows - info.cy, 1e-6)
        depth_m = np.minimum(1.2 * info.fy / below, 5.5) * np.ones((1, info.width))
        shade = np.clip(1.15 - depth_m / 9, 0.2, 1)[..., None]
        floor = rows > info.cy + 1.2 * info.fy / 5.5
        rgb = np.where(floor[..., None], (176, 160, 140), (205, 210, 214)) * shade
        return rgb.astype(np.uint8), (depth_m * 1000).astype(np.uint16)

    def _draw_person(
        self, rgb: U8, depth: U16, pixels: F64, depths_m: F64, shirt: tuple[int, int, int]
    ) -> None:
        mask = np.zeros(depth.shape, np.uint8)
        scale = self.info.fx / float(depths_m.mean())
        at = [(round(float(u)), round(float(v))) for u, v in pixels]
        skin, trousers = (214, 170, 140), (64, 68, 80)
        for number, (a, b) in enumerate(LIMBS):
            colour = shirt if number < 4 else trousers
            for image, value in ((rgb, colour), (mask, (255, 255, 255))):
                cv2.line(image, at[a], at[b], value, max(1, round(0.11 * scale)))
        torso = np.array([at[k] for k in (5, 6, 12, 11)], np.int32)
        head = (at[0][0], at[0][1] - round(0.02 * scale))
        for image, body, face in ((rgb, shirt, skin), (mask, (255,) * 3, (255,) * 3)):
            cv2.polylines(image, [torso], True, body, max(1, round(0.14 * scale)))
            cv2.fillPoly(image, [torso], body)
            cv2.circle(image, head, max(1, round(0.11 * scale)), face, cv2.FILLED)
        depth[mask > 0] = round(float(depths_m.mean()) * 1000)

    def _detection(self, pixels: F64, points: F64) -> Detection:
        scores = np.full((17, 1), 0.9)
        keypoints: F32 = np.hstack([pixels, scores]).astype(np.float32)
        margin = 0.12 * self.info.fx / float(points[:, 2].mean())
        low, high = pixels.min(axis=0) - margin, pixels.max(axis=0) + margin
        return Detection(
            box_xyxy_px=np.concatenate([low, high]).astype(np.float32),
            score=0.87,
            keypoints=keypoints,
            keypoint_depths_m=points[:, 2].astype(np.float32),
            position_m=points[[5, 6, 11, 12]].mean(axis=0),
        )

    def _predictions(self, time_s: float, header: dict[str, Any]) -> Predictions:
        people = []
        for walker in self.walkers:
            position, velocity, _ = walker.state(time_s)
            means = np.array([walker.state(time_s + h)[0] for h in HORIZONS_S])
            sigmas = np.array([0.05 + 0.12 * h for h in HORIZONS_S])
            people.append(
                PersonPrediction(
                    id=walker.number,
                    state="confirmed",
                    position_m=np.array([*position, 1.1]),
                    velocity_mps=velocity,
                    motion=MotionProbabilities(standing=0.1, going_on=0.4, turning=0.5),
                    means_m=means,
                    covariances_m2=sigmas[:, None, None] ** 2 * np.eye(2),
                )
            )
        return Predictions(
            **header, frame_id="map", camera=CAMERA, horizons_s=HORIZONS_S, people=tuple(people)
        )


def _track(
    number: int, index: int, position: F64, velocity: F64, yaw: float, sequence: int
) -> Track:
    return Track(
        id=number,
        state="confirmed",
        position_m=np.array([*position, 1.1]),
        velocity_mps=np.array([*velocity, 0.0]),
        covariance=np.diag([0.01, 0.004, 0.01, 0.05, 0.05, 0.05]),
        yaw_rad=yaw,
        hits=sequence + 1,
        age=sequence + 1,
        time_since_update_s=0.0,
        detection=index,
        score=0.87,
        identity="continued",
        identity_confidence=0.97,
        identity_reason="no other person is near",
    )


def _trace(end_ns: int) -> tuple[Span, ...]:
    spans, start_ns = [], end_ns - sum(round(ms * 1e6) for _, ms in STAGES)
    for stage, ms in STAGES:
        after_ns = start_ns + round(ms * 1e6)
        process = f"{stage.partition('.')[0]}-1@robot"
        spans.append(Span(stage=stage, process=process, start_ns=start_ns, end_ns=after_ns))
        start_ns = after_ns
    return tuple(spans)


class FeedThread:
    """Publishes a feed at a rate until closed.

    Args:
        bus: Bus of the messages.
        feed: Source of the messages.
        rate_hz: Frames a second.
    """

    def __init__(self, bus: ZenohBus, feed: Feed, rate_hz: float = 10.0) -> None:
        self._bus, self._feed, self._period_s = bus, feed, 1 / rate_hz
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._closed.set()
        self._thread.join()

    def _run(self) -> None:
        self._bus.publish(self._feed.info)
        self._bus.publish(self._feed.pose)
        sequence, due_s = 0, time.monotonic()
        while not self._closed.wait(max(0.0, due_s - time.monotonic())):
            for message in self._feed.frame(sequence, time.time_ns()):
                self._bus.publish(message)
            if sequence % max(1, round(0.5 / self._period_s)) == 0:
                for health in self._feed.healths(sequence):
                    self._bus.publish(health)
            sequence += 1
            due_s = max(due_s + self._period_s, time.monotonic() - 1)
