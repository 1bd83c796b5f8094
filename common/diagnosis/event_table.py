"""Events whose cause follows from their counter alone."""

from common.diagnosis.evidence import Level

OTHER_MODEL = "people4d models --verify checks the file; another: --model NAME."
OTHER_TYPES = "Build the nodes with the definitions in common/ros2/definitions, or change those."

# Unreadable messages of ROS 2: counter, problem, and hint.
UNREADABLE = (
    ("bad_message", "messages of ROS 2 are not of the declared type", OTHER_TYPES),
    ("other_type", "a topic of ROS 2 has another type, or another definition of it", OTHER_TYPES),
    (
        *("other_qos", "a publisher of ROS 2 is less reliable than requested: no messages arrive"),
        "Let it publish reliably, or latched, as ros2 topic info -v shows it.",
    ),
    (
        *("no_attachment", "messages arrive on keys of rmw_zenoh without its attachment"),
        "Run the nodes with rmw_zenoh, or set ros2.transport to dds.",
    ),
)

# Frames without the declared form: counter and hint.
REJECTED = {
    "wrong_type": "Convert it in the source; for float metres set depth_in_metres = True there.",
    "wrong_size": "Calibrate at the streamed size, or stream at the calibrated size.",
    "wrong_unit": "Depth is uint16 millimetres, or float metres with depth_in_metres = True.",
    "wrong_stamp": "Give the acquisition time as an int: round(seconds * 1e9).",
}

# Check, level, service, counter of the event, diagnosis (with {name}, the process, and {fault}, its
# reason), and hint.
EVENTS: tuple[tuple[str, Level, str, str, str, str], ...] = (
    (
        *("calibration", "problem", "detector", "no_calibration"),
        "no CameraInfo arrives: frames are dropped, since detections get no positions",
        "Give the camera its calibration: --set camera.options.calibration=FILE.",
    ),
    (
        *("calibration", "problem", "detector", "wrong_size"),
        "frames and CameraInfo differ in size: {fault}",
        REJECTED["wrong_size"],
    ),
    (
        *("frames", "warning", "tracker", "people_unknown"),
        "frames stop for more than 0.5 s; people are unknown until they continue",
        "Look at the camera, its disk or cable, and at the load: people4d top.",
    ),
    (
        *("odometry", "warning", "tracker", "predicted_base"),
        "odometry arrives late or not at all: the robot's motion is predicted",
        "Is odometry published (people4d ps), at 20 Hz or more, with stamps in time?",
    ),
    ("model", "problem", "detector", "model_errors", "{fault}", OTHER_MODEL),
    ("model", "problem", "reid", "embedder_errors", "{fault}", OTHER_MODEL),
    (
        *("ros2", "problem", "ros2_bridge", "reader_unlinked"),
        "people are not sent to ROS 2: {fault}",
        "Does the robot publish its transforms (ros2 topic echo /tf)? Else leave reader_frame out.",
    ),
    (
        *("ros2", "problem", "ros2_bridge", "unknown_frame"),
        "people are not sent to ROS 2: {fault}",
        "Set ros2_bridge.frame_id to a frame that transforms or odometry of people4d lead to.",
    ),
    (
        *("ros2", "problem", "ros2_bridge", "not_extrapolated"),
        "people are not sent to ROS 2: {fault}",
        "Where is the time lost (people4d top)? Are the clocks of camera and robot the same?",
    ),
    (
        *("ros2", "warning", "ros2_bridge", "reader_restamped"),
        "transforms of ROS 2 arrive later than people, which are moved back to their stamps",
        "Publish transforms sooner, or set a longer ros2_bridge.reader_wait_s.",
    ),
    (
        *("ros2", "warning", "camera", "tf_loops"),
        "transforms of ROS 2 form a loop: the closing ones are dropped",
        "Two nodes publish the same frames: ros2 run tf2_tools view_frames shows which.",
    ),
    (
        *("ros2", "warning", "ros2_bridge", "tf_loops"),
        "transforms on /tf close a loop; the last one is dropped",
        "Two nodes publish the same frames: ros2 run tf2_tools view_frames shows which.",
    ),
    (
        *("ros2", "warning", "ros2_bridge", "ros2_unfit"),
        "messages are not sent to ROS 2, since their stamps or numbers are beyond its types",
        "Look at the clock of the camera.",
    ),
    (
        *("ros2", "problem", "ros2_bridge", "send_errors"),
        "messages cannot be sent to ROS 2",
        "Start the service again, and see people4d logs ros2_bridge.",
    ),
    *(
        ("frames", "problem", "camera", counter, "frames of {name} are rejected: {fault}", hint)
        for counter, hint in REJECTED.items()
    ),
    *(
        ("ros2", "warning", service, counter, what, hint)
        for service in ("ros2_bridge", "camera", "gt_bridge")
        for counter, what, hint in UNREADABLE
    ),
)
