"""Configuration of the bridge to ROS 2."""

from typing import Literal

from common.config import Config
from common.ros2.config import Ros2Config
from people4d.messages.base import Name, NameOrEmpty, NonNegative, Positive

Output = Literal[
    "people",
    "markers",
    "prediction_markers",
    "pedestrians",
    "agents",
    "tracked_persons",
    "humans",
    "target",
    "boxes",
    "odometry",
    "tf",
    "clock",
    "diagnostics",
]


class OutputConfig(Config, frozen=True, kw_only=True):
    """One output; without "/" in front its topic is below the namespace."""

    topic: str  # name of the topic, or common first part of several topics
    rate_max_hz: NonNegative = 0.0  # [Hz] maximum rate; 0: no limit


class OutputConfigs(Config, frozen=True, kw_only=True):
    """Topics and rates of all outputs, including unpublished ones."""

    people: OutputConfig = OutputConfig(topic="/people")
    markers: OutputConfig = OutputConfig(topic="people4d/markers", rate_max_hz=15.0)
    prediction_markers: OutputConfig = OutputConfig(topic="people4d/prediction_markers")
    pedestrians: OutputConfig = OutputConfig(topic="/pedestrians")
    agents: OutputConfig = OutputConfig(topic="/tracked_agents")
    tracked_persons: OutputConfig = OutputConfig(topic="/spencer/perception/tracked_persons")
    humans: OutputConfig = OutputConfig(topic="/humans")
    # Chosen person: PoseStamped, and below it person, marker and the commands follow
    target: OutputConfig = OutputConfig(topic="people4d/target")
    boxes: OutputConfig = OutputConfig(topic="people4d/boxes")
    odometry: OutputConfig = OutputConfig(topic="people4d/odometry")
    # Topic of transforms; static ones have the suffix _static
    tf: OutputConfig = OutputConfig(topic="/tf")
    clock: OutputConfig = OutputConfig(topic="/clock")
    diagnostics: OutputConfig = OutputConfig(topic="/diagnostics", rate_max_hz=1.0)


class Ros2BridgeConfig(Config, frozen=True, kw_only=True):
    """Published topics, and the frames, stamps and conventions of their readers."""

    ros2: Ros2Config = Ros2Config()  # connection and name of the node
    # outputs: people (people_msgs), markers and prediction_markers (RViz), pedestrians
    # (social_nav_msgs), agents (CoHAN), tracked_persons (SPENCER), humans (ROS4HRI), target (the
    # chosen person), boxes (vision_msgs), odometry, tf, clock (of the recording, for use_sim_time),
    # diagnostics
    publish: tuple[Output, ...] = ("people", "markers")
    outputs: OutputConfigs = OutputConfigs()
    # convention of people_msgs: nav2 (nav2_social_costmap_plugin, people in RViz) or sfm
    # (social_force_window_planner)
    convention: Literal["nav2", "sfm"] = "nav2"
    # states of published tracks
    states: tuple[Literal["tentative", "confirmed", "lost"], ...] = ("confirmed", "lost")
    # frame of published people; empty: frame of the tracks, "map" unless set otherwise
    frame_id: NameOrEmpty = ""
    # other names of frames in ROS, for example {map = "robot1/map"}
    frame_names: dict[str, str] = {}  # noqa: RUF012 (msgspec copies it)
    # stamps: acquired (of the image), or sent (now; people are moved by their velocities over at
    # most 0.5 s). sent is for recordings, whose stamps are mapped to the time of playback, and for
    # readers that reject messages older than 0.1 s, as CoHAN
    stamps: Literal["acquired", "sent"] = "acquired"
    # frame to which a reader transforms people, for example odom: people are sent once its lookup
    # on /tf at their stamp succeeds; empty: immediately
    reader_frame: str = ""
    reader_wait_s: Positive = 0.1  # [s] maximum wait for a transform at the stamp
    base_frame: Name = "base_link"  # the robot's base, with which people are engaged
    box_m: tuple[Positive, Positive, Positive] = (0.5, 0.6, 1.75)  # [m] depth, width, height
