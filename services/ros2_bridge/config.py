"""Configuration of the bridge to ROS 2."""

from collections.abc import Mapping
from typing import Literal, get_args

from common.config import Config
from common.ros2.config import Ros2Config
from people4d.messages.base import NameOrEmpty, NonNegative, Positive

Output = Literal[
    "people",
    "markers",
    "prediction_markers",
    "pedestrians",
    "agents",
    "tracked_persons",
    "odometry",
    "tf",
    "clock",
    "diagnostics",
]
OUTPUTS: tuple[Output, ...] = get_args(Output)
# Topics by output; without "/" in front a topic is below the namespace
TOPICS: Mapping[Output, str] = {
    "people": "/people",
    "markers": "people4d/markers",
    "prediction_markers": "people4d/prediction_markers",
    "pedestrians": "/pedestrians",
    "agents": "/tracked_agents",
    "tracked_persons": "/spencer/perception/tracked_persons",
    "odometry": "people4d/odometry",
    "tf": "/tf",
    "clock": "/clock",
    "diagnostics": "/diagnostics",
}
# Maximum rates by output [Hz]; all messages of the others are sent
RATES_MAX_HZ: Mapping[Output, float] = {"markers": 15.0, "diagnostics": 1.0}


class Ros2BridgeConfig(Config, frozen=True, kw_only=True):
    """Published topics, and the frames, stamps and conventions of their readers."""

    ros2: Ros2Config = Ros2Config()  # connection and name of the node
    # outputs: people (people_msgs), markers and prediction_markers (RViz), pedestrians
    # (social_nav_msgs), agents (CoHAN), tracked_persons (SPENCER), odometry, tf, clock (of the
    # recording, for use_sim_time), diagnostics
    publish: tuple[Output, ...] = ("people", "markers")
    # other topics by output, for example {markers = "/people_in_rviz"}
    topics: dict[Output, str] = {}  # noqa: RUF012 (msgspec copies it)
    # other maximum rates by output [Hz], for example {people = 10.0}; 0: all messages are sent
    rates_max_hz: dict[Output, NonNegative] = {}  # noqa: RUF012 (msgspec copies it)
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
    # most 0.5 s). sent is for recordings, whose stamps are mapped to the time of their playing, and
    # for readers that refuse messages older than 0.1 s, as CoHAN does
    stamps: Literal["acquired", "sent"] = "acquired"
    # frame that a reader transforms people to, for example odom: people wait for its transforms on
    # /tf, so that its lookup at the stamp succeeds; empty: people are sent at once
    reader_frame: str = ""
    reader_wait_s: Positive = 0.1  # longest wait for a transform as late as the stamp [s]
    box_m: tuple[Positive, Positive, Positive] = (0.5, 0.6, 1.75)  # depth, width, height [m]

    def topic(self, output: Output) -> str:
        """Return the topic of an output."""
        return self.topics.get(output, TOPICS[output])

    def rate_max_hz(self, output: Output) -> float:
        """Return the maximum rate of an output [Hz]; 0 if all messages are sent."""
        return self.rates_max_hz.get(output, RATES_MAX_HZ.get(output, 0.0))
