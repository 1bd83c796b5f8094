"""One message of each type with every field filled, and with every optional field left out."""

import numpy as np

from common.messages import (
    Alignment,
    CameraInfo,
    CompressedRgbdFrame,
    Crop,
    Crops,
    Detection,
    Detections,
    Embeddings,
    Health,
    Mask,
    Message,
    MovingTransform,
    Odometry,
    PersonScore,
    RgbdFrame,
    Score,
    Span,
    StaticTransform,
    Tally,
    Track,
    Tracks,
    Truth,
    TruthPerson,
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

FULL: tuple[Message, ...] = (
    CameraInfo(
        stamp_ns=STAMP_NS,
        sequence=0,
        trace=(SPAN,),
        camera="front",
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
        stamp_ns=STAMP_NS,
        sequence=1,
        trace=(SPAN,),
        camera="front",
        rgb=RGB,
        depth_mm=DEPTH,
        lockstep=True,
    ),
    CompressedRgbdFrame(
        stamp_ns=STAMP_NS,
        sequence=2,
        trace=(SPAN,),
        camera="front",
        rgb_jpeg=JPEG,
        depth_png=PNG,
    ),
    StaticTransform(
        stamp_ns=STAMP_NS,
        sequence=3,
        trace=(SPAN,),
        parent="map",
        child="front_optical_frame",
        matrix=np.eye(4),
    ),
    MovingTransform(
        stamp_ns=STAMP_NS,
        sequence=4,
        trace=(SPAN,),
        parent="base_link",
        child="head",
        matrix=np.eye(4),
    ),
    Odometry(
        stamp_ns=STAMP_NS,
        sequence=4,
        trace=(SPAN,),
        frame_id="odom",
        child_frame_id="base_link",
        x_m=1.5,
        y_m=-2.5,
        theta_rad=3.0,
        covariance=np.eye(3),
        twist=np.array([0.5, 0.0, -0.1]),
    ),
    Detections(
        stamp_ns=STAMP_NS,
        sequence=5,
        trace=(SPAN,),
        camera="front",
        frame_id="front_optical_frame",
        model="movenet",
        width=640,
        height=480,
        people=(DETECTION,),
    ),
    Crops(
        stamp_ns=STAMP_NS,
        sequence=6,
        trace=(SPAN,),
        camera="front",
        people=(Crop(detection=0, rgb=RGB, mask=RGB[..., 0], keypoints=KEYPOINTS),),
    ),
    Embeddings(
        stamp_ns=STAMP_NS,
        sequence=7,
        trace=(SPAN,),
        camera="front",
        model="histogram",
        detections=(0, 2),
        vectors=np.eye(2, 4, dtype=np.float32),
    ),
    Tracks(
        stamp_ns=STAMP_NS,
        sequence=8,
        trace=(SPAN,),
        frame_id="map",
        tracker="sort3d",
        camera="front",
        people=(TRACK,),
    ),
    Truth(
        stamp_ns=STAMP_NS,
        sequence=9,
        trace=(SPAN,),
        frame_id="map",
        people=(
            TruthPerson(
                id="anna", position_m=np.ones(3), velocity_mps=np.array([1.0, 0, 0]), yaw_rad=1.0
            ),
        ),
    ),
    Score(
        stamp_ns=STAMP_NS,
        sequence=10,
        trace=(SPAN,),
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
        stamp_ns=STAMP_NS,
        sequence=11,
        trace=(SPAN,),
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

# What the wire may hold where nothing is known: nil, no people, arrays of no length.
SPARSE: tuple[Message, ...] = (
    CameraInfo(
        stamp_ns=-1,
        sequence=0,
        camera="c",
        frame_id="f",
        width=1,
        height=1,
        fx=1.0,
        fy=1.0,
        cx=0.0,
        cy=0.0,
    ),
    MovingTransform(stamp_ns=0, sequence=0, parent="a", child="b", matrix=np.eye(4)),
    Odometry(
        stamp_ns=0, sequence=0, frame_id="o", child_frame_id="b", x_m=0.0, y_m=0.0, theta_rad=0.0
    ),
    Detections(
        stamp_ns=0, sequence=0, camera="c", frame_id="f", model="m", width=1, height=1, people=()
    ),
    Detections(
        stamp_ns=0,
        sequence=0,
        camera="c",
        frame_id="f",
        model="m",
        width=1,
        height=1,
        people=(Detection(box_xyxy_px=np.zeros(4, np.float32), score=0.0),),
    ),
    Crops(
        stamp_ns=0,
        sequence=0,
        camera="c",
        people=(Crop(detection=0, rgb=RGB), Crop(detection=1, rgb=RGB)),
    ),
    Embeddings(
        stamp_ns=0,
        sequence=0,
        camera="c",
        model="m",
        detections=(),
        vectors=np.zeros((0, 512), np.float32),
    ),
    Tracks(stamp_ns=0, sequence=0, frame_id="map", tracker="t", camera="c"),
    Truth(
        stamp_ns=0, sequence=0, frame_id="map", people=(TruthPerson(id="", position_m=np.ones(3)),)
    ),
    Score(
        stamp_ns=0,
        sequence=0,
        frame_id="map",
        camera="c",
        people=(PersonScore(id="", view="unknown"),),
        recent=NOTHING,
        total=NOTHING,
        alignment=Alignment(applied=False),
    ),
    Health(stamp_ns=0, sequence=0, service="s", instance="i", host="", pid=0, state="ready"),
)

BY_NAME = {type(message).__name__: message for message in FULL}
