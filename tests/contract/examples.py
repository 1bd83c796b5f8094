"""One message of each type with every field filled, and with every optional field left out."""

from typing import Any

import msgspec
import numpy as np

from people4d.messages import (
    Alignment,
    AreaPeople,
    AreaPerson,
    BodyPoint,
    CameraInfo,
    CompressedRgbdFrame,
    Crop,
    Crops,
    Detection,
    Detections,
    Embeddings,
    Event,
    Gait,
    GaitMeasures,
    Health,
    ImageTrack,
    ImageTracks,
    Mask,
    Message,
    MotionProbabilities,
    MovingTransform,
    Odometry,
    PersonGait,
    PersonPrediction,
    PersonScore,
    PersonSkeleton,
    Predictions,
    RgbdFrame,
    RobotEncounter,
    Score,
    Skeletons,
    Span,
    StaticTransform,
    Tally,
    Target,
    TargetCommand,
    Track,
    Tracks,
    Truth,
    TruthPerson,
    Zone,
    ZoneEdit,
    Zones,
)

SPAN = Span(stage="camera.read", process="camera-1@host", start_ns=5, end_ns=9)
STAMP_NS = 1_700_000_000_123_456_789
RGB = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
DEPTH = np.array([[0, 1, 256], [1000, 5000, 65535]], np.uint16)
KEYPOINTS = np.arange(17 * 3, dtype=np.float32).reshape(17, 3)
JPEG, PNG = b"\xff\xd8\xff\xe0", b"\x89PNG\r\n\x1a\n\x00"

DETECTION = Detection(
    box_xyxy_px=np.array([-1.5, 0, 2, 1], np.float32),
    score=0.75,
    person=0.625,
    keypoints=KEYPOINTS,
    mask=Mask.from_array(np.array([[0, 1, 1], [1, 0, 1]], np.uint8), 4, 5),
    position_m=np.array([0.5, -0.25, 2.0]),
    position_covariance_m2=np.diag([0.01, 0.01, 0.04]),
    heading=np.array([0.6, 0.0, -0.8]),
    heading_sigma_rad=0.25,
)
TRACK = Track(
    id=7,
    state="confirmed",
    position_m=np.array([1.0, 2.0, 3.0]),
    velocity_mps=np.array([0.1, 0.2, 0.0]),
    covariance=np.arange(36.0).reshape(6, 6),
    yaw_rad=-3.0,
    hits=4,
    age=5,
    time_since_update_s=0.125,
    detection=0,
    score=0.5,
)
TALLY = Tally(
    frames=2,
    duration_s=0.5,
    truths=4,
    matched=3,
    predicted=1,
    outside=2,
    false_alarms=1,
    id_switches=1,
    position_rmse_m=0.25,
    velocity_rmse_mps=0.5,
    yaw_rmse_rad=0.125,
    yaw_correlation=0.75,
)
NOTHING = Tally(
    frames=0,
    duration_s=0.0,
    truths=0,
    matched=0,
    predicted=0,
    outside=0,
    false_alarms=0,
    id_switches=0,
)
ZONE = Zone(
    name="door",
    corners_m=np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.5], [0.0, 1.5]]),
    dwell_s=10.0,
    count=3,
)
HEAD: dict[str, Any] = {"stamp_ns": STAMP_NS, "trace": (SPAN,)}
FRAME = HEAD | {"camera": "front"}

FULL: tuple[Message, ...] = (
    CameraInfo(
        **FRAME,
        sequence=0,
        frame_id="front_optical_frame",
        width=640,
        height=480,
        fx=600.5,
        fy=601.5,
        cx=320.0,
        cy=240.0,
        distortion_model="plumb_bob",
        distortion=(0.1, -0.2, 0.0, 0.0, 0.01),
        max_depth_m=4.0,
    ),
    RgbdFrame(
        **FRAME,
        sequence=1,
        rgb=RGB,
        depth_mm=DEPTH,
        lockstep=True,
    ),
    CompressedRgbdFrame(**FRAME, sequence=2, rgb_jpeg=JPEG, depth_png=PNG),
    StaticTransform(
        **HEAD,
        sequence=3,
        parent="map",
        child="front_optical_frame",
        matrix=np.eye(4),
    ),
    MovingTransform(
        **HEAD,
        sequence=4,
        parent="base_link",
        child="head",
        matrix=np.eye(4),
    ),
    Odometry(
        **HEAD,
        sequence=4,
        frame_id="odom",
        child_frame_id="base_link",
        x_m=1.5,
        y_m=-2.5,
        theta_rad=3.0,
        covariance=np.eye(3),
        twist=np.array([0.5, 0.0, -0.1]),
    ),
    Detections(
        **FRAME,
        sequence=5,
        frame_id="front_optical_frame",
        model="movenet",
        width=640,
        height=480,
        detections=(DETECTION,),
    ),
    Crops(
        **FRAME,
        sequence=6,
        crops=(Crop(detection=0, rgb=RGB, mask=RGB[..., 0], keypoints=KEYPOINTS),),
    ),
    Embeddings(
        **FRAME,
        sequence=7,
        model="histogram",
        detections=(0, 2),
        vectors=np.eye(2, 4, dtype=np.float32),
    ),
    AreaPeople(
        **HEAD,
        sequence=7,
        area="hall_a",
        number=1,
        run=2**52,
        frame_id="map",
        embedder="histogram",
        people=(
            AreaPerson(
                id=1001,
                position_m=np.array([1.0, 2.0, 3.0]),
                unmatched_s=0.5,
                matches=9,
                views=np.eye(2, 4, dtype=np.float32),
            ),
        ),
    ),
    Tracks(
        **HEAD,
        sequence=8,
        frame_id="map",
        tracker="sort3d",
        camera="front",
        tracks=(TRACK,),
    ),
    ImageTracks(
        **FRAME,
        sequence=8,
        tracker="image_sort",
        width=640,
        height=480,
        tracks=(
            ImageTrack(
                id=7,
                state="lost",
                box_xyxy_px=np.array([-1.5, 0, 2, 1]),
                hits=4,
                time_since_update_s=0.125,
                detection=0,
                score=0.5,
            ),
        ),
    ),
    Gait(
        **HEAD,
        sequence=8,
        frame_id="map",
        camera="front",
        people=(
            PersonGait(
                id=7,
                box_xyxy_px=np.array([-1.5, 0, 2, 1], np.float32),
                points=(
                    BodyPoint(
                        name="left_foot",
                        state="measured",
                        position_m=np.array([1.0, 2.0, 0.125]),
                        velocity_mps=np.array([0.5, 0.25, 0.0]),
                        covariance=np.arange(36.0).reshape(6, 6),
                        confidence=0.75,
                    ),
                ),
                measures=GaitMeasures(
                    steps=6,
                    step_length_m=0.625,
                    stride_length_m=1.25,
                    cadence_per_min=110.5,
                    walking_speed_mps=1.125,
                    step_time_asymmetry=-0.0625,
                ),
            ),
        ),
    ),
    Predictions(
        **HEAD,
        sequence=8,
        frame_id="map",
        camera="front",
        horizons_s=(0.5, 1.0),
        people=(
            PersonPrediction(
                id=7,
                state="lost",
                position_m=np.array([1.0, 2.0, 3.0]),
                velocity_mps=np.array([0.5, 0.25]),
                motion=MotionProbabilities(standing=0.25, going_on=0.5, turning=0.25),
                means_m=np.array([[1.25, 2.125], [1.5, 2.25]]),
                covariances_m2=np.array([[[0.5, 0.25], [0.25, 1.0]], [[1.0, 0.0], [0.0, 2.0]]]),
                group=3,
                robot=RobotEncounter(
                    closest_approach_s=0.75, closest_distance_m=1.5, path_distance_m=0.5
                ),
            ),
        ),
        robot_m=np.array([[0.25, 0.0], [0.5, 0.0]]),
    ),
    Skeletons(
        **HEAD,
        sequence=8,
        frame_id="map",
        camera="front",
        people=(
            PersonSkeleton(
                id=7,
                state="confirmed",
                positions_m=(np.arange(51).reshape(17, 3) / 8).astype(np.float32),
                covariances_m2=np.tile(np.eye(3, dtype=np.float32), (17, 1, 1)),
                measured=(True, *[False] * 16),
                posture="sitting",
                posture_probability=0.75,
            ),
        ),
    ),
    Event(
        **HEAD,
        sequence=4,
        kind="left",
        id=7,
        zone="door",
        position_m=np.array([1.0, -2.0, 0.9]),
        frame_id="odom",
        dwell_s=12.5,
        count=2,
        wall_ns=STAMP_NS,
        distance_m=0.75,
        confidence=0.5,
        direction=np.array([0.6, 0.0, -0.8]),
        target_m=np.array([1.5, -2.0, 0.0]),
        reason="two people look alike",
    ),
    Zones(**HEAD, sequence=3, zones=(ZONE,), problem="too late"),
    ZoneEdit(**HEAD, sequence=2, base=3, zones=(ZONE,)),
    Target(
        **HEAD,
        sequence=5,
        state="locked",
        frame_id="map",
        camera="front",
        id=7,
        position_m=np.array([3.0, 4.0, 1.0]),
        velocity_mps=np.array([0.5, 0.0, 0.0]),
        probability=0.99,
        reason="continued",
        distance_m=5.0,
        bearing_rad=0.5,
        stop=False,
        path_times_s=(0.5,),
        path_m=np.array([[3.25, 4.0]]),
        chooser="planner",
    ),
    TargetCommand(**HEAD, sequence=0, action="id", id=7, chooser="me"),
    Truth(
        **HEAD,
        sequence=9,
        frame_id="map",
        people=(
            TruthPerson(
                id="anna", position_m=np.ones(3), velocity_mps=np.array([1.0, 0, 0]), yaw_rad=1.0
            ),
        ),
    ),
    Score(
        **HEAD,
        sequence=10,
        frame_id="map",
        camera="front",
        people=(
            PersonScore(
                id="anna",
                view="inside",
                track=7,
                predicted=True,
                switched=True,
                position_error_m=np.array([0.1, -0.2]),
                velocity_error_mps=np.array([0.5, 0.0]),
                yaw_error_rad=-0.5,
                consistency=0.75,
            ),
        ),
        false_alarms=(9,),
        recent=TALLY,
        total=TALLY,
        id_consistency=0.875,
        alignment=Alignment(
            applied=True,
            clock_offset_s=0.08,
            clock_sigma_s=0.001,
            matrix=np.eye(4),
            rmse_before_m=0.25,
            rmse_after_m=0.125,
        ),
    ),
    Health(
        **HEAD,
        sequence=11,
        service="tracker",
        instance="tracker-1",
        host="robot",
        pid=42,
        state="degraded",
        reason="no transforms yet",
        counters={"received_detections": 3},
        gauges={"received_detections_hz": 29.5},
    ),
)


def stripped(record: Any, *, inner: bool = False) -> Any:
    """Return a record with its required fields alone; `inner`: strip the records in it alone."""
    if isinstance(record, tuple):
        return tuple(map(stripped, record))
    if not isinstance(record, msgspec.Struct):
        return record
    names = [f.name for f in msgspec.structs.fields(record) if f.required or inner]
    return type(record)(**{name: stripped(getattr(record, name)) for name in names})


BY_NAME = {type(message).__name__: message for message in FULL}


def changed(name: str, **fields: Any) -> Any:
    """Return the message of a type with its required fields alone and some values."""
    return msgspec.structs.replace(stripped(BY_NAME[name]), **fields)


# Valid values on the wire for unknown data: nil, no people, arrays of length 0.
SPARSE: tuple[Message, ...] = (
    *(stripped(message) for message in FULL if not isinstance(message, TargetCommand)),
    TargetCommand(stamp_ns=0, sequence=0, action="none"),
    changed("Detections", stamp_ns=-1, detections=()),
    changed("AreaPeople", embedder=""),
    changed("Health", host="", pid=0),
    changed("Truth", people=(TruthPerson(id="", position_m=np.ones(3)),)),
    changed(
        "Score",
        people=(PersonScore(id="", view="unknown"),),
        recent=NOTHING,
        total=NOTHING,
        alignment=Alignment(applied=False),
    ),
    *(stripped(message, inner=True) for message in FULL),
    changed("Embeddings", detections=(), vectors=np.zeros((0, 512), np.float32)),
)
