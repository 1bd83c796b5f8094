"""RGB-D frames to people with positions and headings, and their crops."""

import logging
import threading
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import cv2
import numpy as np

from common.runtime.node import NO_LOOP, LoopCallbacks, Node, Sharing, Status
from common.transport.trace import span
from people4d.messages import (
    F32,
    CameraInfo,
    Crops,
    Detection,
    Detections,
    Mask,
    Message,
    RgbdFrame,
)
from people4d.messages.base import MAX_CAMERAS
from services.detector.config import DetectorConfig
from services.detector.crop_schedule import CropSchedule
from services.detector.crops import FRONT_M, crop_person, hidden_pixels
from services.detector.models.base import DetectedPerson, PersonModel
from services.detector.orientation.angle import YawEstimate, heading_vector
from services.detector.orientation.estimator import OrientationEstimator
from services.detector.orientation.network import OrientationNetwork
from services.detector.position.body import BodyNetwork
from services.detector.position.estimator import PositionEstimator
from services.detector.position.silhouette import grow_mask
from services.detector.position.surface import DepthImage, PositionEstimate, keypoint_surfaces
from services.detector.position.torso import LayeredTorso, find_torsos

log = logging.getLogger("people4d")

# Minimum number of detected people, all without a position, that degrades the service
PEOPLE_MIN = 10


class DetectorNode(Node):
    """Detects people in each frame and estimates their positions and headings from depth.

    Each frame requires an earlier CameraInfo of its camera. `handle` is thread-safe if the model
    is.

    Args:
        model: Finds people in each image.
        config: Configuration of the service.
        orientation_network: Yaws by images of people; None: yaws by keypoints alone.
        body_network: Positions by images of people, required by the method "network".
    """

    inputs: tuple[type[Message], ...] = (CameraInfo, RgbdFrame)
    sharing: ClassVar[Sharing] = Sharing(RgbdFrame, Detections)
    required_inputs: ClassVar[tuple[type[Message], ...]] = (RgbdFrame,)
    workers = 2  # one worker prepares a frame while the other infers

    def __init__(
        self,
        model: PersonModel,
        config: DetectorConfig,
        orientation_network: OrientationNetwork | None = None,
        body_network: BodyNetwork | None = None,
    ) -> None:
        self._model = model
        self._config = config
        self._positions = PositionEstimator(config, model.name, body_network)
        self._confidence_min = config.confidence_for(model.name)
        self._schedule = CropSchedule()
        self._orientation = OrientationEstimator(config, model.name, orientation_network)
        self._lock = threading.Lock()
        self._calibrations: dict[str, CameraInfo] = {}
        self._counters: Counter[str] = Counter()
        self._faults: dict[str, str] = {}  # fault of the newest frame by camera
        self._loop = NO_LOOP

    def attach(self, loop: LoopCallbacks) -> None:
        """Set the callbacks of the loop."""
        self._loop = loop

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Process a calibration or a frame; return Detections and, if configured, Crops."""
        if isinstance(message, CameraInfo):
            with self._lock:
                known = message.camera in self._calibrations
                if known or len(self._calibrations) < MAX_CAMERAS:
                    self._calibrations[message.camera] = message
                else:
                    self._counters["refused_cameras"] += 1
            return ()
        if not isinstance(message, RgbdFrame):
            return ()
        info = self._calibration(message)
        return () if info is None else self._detect(message, info)

    def status(self) -> Status:
        """Return the counters, and the faults of the newest frames as the reason."""
        with self._lock:
            faults = [f"camera {name}: {fault}" for name, fault in self._faults.items()]
            counters = dict(self._counters)
        people = counters.get("people", 0)
        if people >= PEOPLE_MIN and not counters["with_position"] and not faults:
            hint = "is depth in the right unit, and aligned to colour?"
            faults.append(f"none of {people} people has a position: {hint}")
        reason = "; ".join(faults)
        return Status(state="degraded" if reason else "ready", reason=reason, counters=counters)

    def _calibration(self, frame: RgbdFrame) -> CameraInfo | None:
        """Return the calibration of a frame; None, counted, without a matching one."""
        with self._lock:
            self._counters["frames"] += 1
            info = self._calibrations.get(frame.camera)
        height, width = frame.depth_mm.shape
        if info is None:
            self._fault(
                frame, "no_calibration", "no CameraInfo was received, its frames are dropped"
            )
        elif (info.height, info.width) != (height, width):
            expected = f"{info.width}x{info.height}"
            why = f"expected {expected} as in its CameraInfo, got {width}x{height}"
            self._fault(frame, "wrong_size", f"frames are dropped: {why}")
            return None
        return info

    def _detect(self, frame: RgbdFrame, info: CameraInfo) -> Sequence[Message]:
        people, image = self._find_people(frame), DepthImage(frame.depth_mm, info)
        boxes = np.array([p.box_xyxy_px for p in people], np.float64).reshape(-1, 4)
        is_due = self._schedule.due(frame, boxes) if self._config.crops else []
        with span("hand_over"):
            self._loop.release()
        if self._config.position == "grown":
            with span("locate"):
                people = [self._with_mask(person, image) for person in people]
        with span("locate"):
            torsos = self._find_torsos(people, image)
        outputs, cropped = list[Message](), 0
        if self._config.crops:
            # Crops first, since the tracker waits for their embeddings.
            crops = self._crops(people, torsos, is_due, frame)
            (self._loop.publish or outputs.append)(crops)
            cropped = len(crops.crops)
        bodies = self._positions.observe(torsos, frame.rgb, image)
        observed = self._orientation.observe(people, torsos, frame.rgb, image)
        with span("locate"):
            yaws = self._orientation.estimate(people, image, observed)
            detections = self._detections(people, bodies, image, yaws)
        with self._lock:
            self._counters["people"] += len(people)
            self._counters["with_position"] += sum(d.position_m is not None for d in detections)
            self._counters["with_heading"] += sum(d.heading is not None for d in detections)
        detector, replicas = self._loop.replicas()
        result = Detections(
            stamp_ns=frame.stamp_ns,
            sequence=frame.sequence,
            trace=frame.trace,
            camera=frame.camera,
            frame_id=info.frame_id,
            model=self._model.name,
            detector=detector,
            replicas=replicas,
            width=info.width,
            height=info.height,
            detections=detections,
            crops=cropped,
        )
        return [*outputs, result]

    def _find_people(self, frame: RgbdFrame) -> list[DetectedPerson]:
        """Return the people in the colour image; none, counted, if the model fails."""
        try:
            people = self._model.detect(frame.rgb)
        except Exception as error:  # a plug-in model may raise any exception
            log.debug("the model failed", exc_info=True)
            self._fault(frame, "model_errors", f"the model failed: {error!r:.200}")
            return []
        if cv2.hasNonZero(frame.depth_mm):  # ends at the first reading
            with self._lock:
                self._faults.pop(frame.camera, None)
        else:
            self._fault(frame, "no_depth", "its depth image is empty, people have no positions")
        return people

    def _with_mask(self, person: DetectedPerson, image: DepthImage) -> DetectedPerson:
        """Return the person with a mask grown in depth."""
        if person.keypoints is None:
            return person
        return replace(person, mask=grow_mask(person, image))

    def _find_torsos(
        self, people: Sequence[DetectedPerson], image: DepthImage
    ) -> Sequence[LayeredTorso | None]:
        """Return the torsos if positions or yaws need them, else None each."""
        if self._orientation.method == "joint" or self._config.position == "network":
            return find_torsos(people, self._confidence_min, image)
        return [None] * len(people)

    def _detections(
        self,
        people: Sequence[DetectedPerson],
        bodies: Sequence[PositionEstimate | None],
        image: DepthImage,
        yaws: Sequence[YawEstimate | None],
    ) -> tuple[Detection, ...]:
        yaws_rad = [None if yaw is None else yaw.rad for yaw in yaws]
        positions = self._positions.estimate(people, bodies, image, yaws_rad)
        depths_m = keypoint_surfaces(people, image)
        return tuple(map(_detection, people, yaws, positions, depths_m))

    def _crops(
        self,
        people: Sequence[DetectedPerson],
        torsos: Sequence[LayeredTorso | None],
        is_due: Sequence[bool],
        frame: RgbdFrame,
    ) -> Crops:
        height_px, crops = self._config.crop_height_max_px, []
        with span("crops"):
            for k in np.flatnonzero(is_due).tolist():
                person, torso, hidden = people[k], torsos[k], None
                if torso is not None:
                    nearest_m = torso.layer.depth_m - FRONT_M
                    hidden = hidden_pixels(person.box_xyxy_px, frame.depth_mm, nearest_m)
                crops.append(crop_person(k, person, frame.rgb, height_px, hidden))
        return Crops(
            stamp_ns=frame.stamp_ns,
            sequence=frame.sequence,
            trace=frame.trace,
            camera=frame.camera,
            crops=tuple(crop for crop in crops if crop is not None),
        )

    def _fault(self, frame: RgbdFrame, counter: str, reason: str) -> None:
        with self._lock:
            self._counters[counter] += 1
            self._faults[frame.camera] = reason


def _detection(
    person: DetectedPerson,
    yaw: YawEstimate | None,
    position: PositionEstimate | None,
    depths_m: F32 | None,
) -> Detection:
    mask = person.mask
    return Detection(
        box_xyxy_px=person.box_xyxy_px,
        score=person.score,
        person=None if position is None else position.person,
        keypoints=person.keypoints,
        keypoint_depths_m=depths_m,
        mask=None if mask is None else Mask.from_array(mask.window, mask.x_px, mask.y_px),
        position_m=None if position is None else position.position_m,
        position_covariance_m2=None if position is None else position.covariance_m2,
        heading=None if yaw is None else heading_vector(yaw.rad),
        heading_sigma_rad=None if yaw is None else yaw.sigma_rad,
    )
