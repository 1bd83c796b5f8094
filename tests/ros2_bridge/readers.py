"""Planners that read people, rule by rule; a rule that fails is a refusal.

Written from the sources of nav2_social_costmap_plugin (social_layer.cpp: updateBounds),
social_force_window_planner (sensor_interface.cpp: peopleCb) and CoHAN (agent_layer.cpp:
updateBounds, agent_path_prediction.cpp: predictAgents), and of tf2 (buffer_core.cpp,
time_cache.cpp).
"""

import bisect
import math
import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from common.geometry.transforms import invert, rotation_from_rpy, transform_from

CACHE_NS = 10 * 10**9
COHAN_OLD_NS = 100_000_000
TORSO = 1
INT_MAX = 2**31 - 1

F64 = npt.NDArray[np.float64]


class RefusalError(Exception):
    """A message that a planner cannot use."""


@dataclass
class Tf2Buffer:
    """Transforms on the plane as tf2 holds them: no extrapolation, 10 s of history."""

    static: dict[str, tuple[str, F64]] = field(default_factory=dict)
    moving: dict[str, tuple[str, list[int], list[F64]]] = field(default_factory=dict)

    def set_transform(self, parent: str, child: str, stamp_ns: int, matrix: F64) -> None:
        """Add a sample; 4x4 parent_from_child."""
        _, stamps, matrices = self.moving.setdefault(child, (parent, [], []))
        index = bisect.bisect(stamps, stamp_ns)
        stamps.insert(index, stamp_ns)
        matrices.insert(index, matrix)
        while stamps[-1] - stamps[0] > CACHE_NS:
            del stamps[0], matrices[0]

    def lookup(self, target: str, source: str, stamp_ns: int) -> F64:
        """Return target_from_source at a stamp, or raise RefusalError."""
        roots = [self._climb(frame, stamp_ns) for frame in (target, source)]
        common = [frame for frame in roots[0] if frame in roots[1]]
        if not common:
            raise RefusalError(f"{target} and {source} are not connected")
        upper = common[0]
        for chain in roots:  # only the transforms up to the common frame are asked for
            for frame in list(chain)[: list(chain).index(upper) + 1]:
                if chain[frame] is None:
                    raise RefusalError(f"extrapolation of {frame} at {stamp_ns}")
        of_target, of_source = roots[0][upper], roots[1][upper]
        assert of_target is not None
        assert of_source is not None
        return invert(of_target) @ of_source

    def _climb(self, frame: str, stamp_ns: int) -> dict[str, F64 | None]:
        """Return ancestor_from_frame by ancestor, None where there is no sample then."""
        chain: dict[str, F64 | None] = {frame: np.eye(4)}
        while frame in self.static or frame in self.moving:
            if frame in self.static:
                parent, matrix = self.static[frame]
                found: F64 | None = matrix
            else:
                parent, stamps, matrices = self.moving[frame]
                found = _between(stamps, matrices, stamp_ns)
            below = chain[frame]
            chain[parent] = None if below is None or found is None else found @ below
            frame = parent
        return chain


def _between(stamps: list[int], matrices: list[F64], stamp_ns: int) -> F64 | None:
    if not stamps[0] <= stamp_ns <= stamps[-1]:
        return None
    after = max(bisect.bisect_left(stamps, stamp_ns), 1) if len(stamps) > 1 else 0
    if after == 0:
        return matrices[0]
    share = (stamp_ns - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
    (x0, y0, a0), (x1, y1, a1) = (_planar(matrices[k]) for k in (after - 1, after))
    turn = math.remainder(a1 - a0, 2 * math.pi)
    rotation = rotation_from_rpy(0.0, 0.0, a0 + share * turn)
    return transform_from((x0 + share * (x1 - x0), y0 + share * (y1 - y0), 0.0), rotation)


def _planar(matrix: F64) -> tuple[float, float, float]:
    yaw_rad = math.atan2(matrix[1, 0], matrix[0, 0])
    return float(matrix[0, 3]), float(matrix[1, 3]), yaw_rad


def stamp_ns(message: Any) -> int:
    """Return the stamp of a header."""
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def stoi(text: str) -> int:
    """Read a number as std::stoi does: blanks and sign first, the rest left out."""
    number = re.match(r"[ \t\n\v\f\r]*([+-]?\d+)", text)
    if number is None:
        raise RefusalError(f"std::invalid_argument: stoi({text!r})")
    if not -INT_MAX - 1 <= int(number[1]) <= INT_MAX:
        raise RefusalError(f"std::out_of_range: stoi({text!r})")
    return int(number[1])


def read_social_costmap(message: Any, tf: Tf2Buffer, global_frame: str) -> list[list[float]]:
    """Return x, y, vx, vy of each person in the costmap's frame."""
    found = []
    for person in message.people:
        matrix = tf.lookup(global_frame, message.header.frame_id, stamp_ns(message))
        at = np.array([person.position.x, person.position.y, person.position.z, 1.0])
        by = np.array([person.velocity.x, person.velocity.y, person.velocity.z, 0.0])
        position, tip = matrix @ at, matrix @ (at + by)
        found.append([*position[:2].tolist(), *(tip - position)[:2].tolist()])
    return found


def read_social_force(
    message: Any, tf: Tf2Buffer, controller_frame: str, odometry_ns: int
) -> list[dict[str, float]]:
    """Return the agents; poses are looked up at the stamp of the robot's odometry."""
    agents = []
    for person in message.people:
        if len(person.tags) < 2:
            raise RefusalError("tags[1] is read beyond the end")
        id_, group = stoi(person.tags[0]), stoi(person.tags[1])
        matrix = np.eye(4)
        if message.header.frame_id != controller_frame:
            matrix = tf.lookup(controller_frame, message.header.frame_id, odometry_ns)
        position = matrix @ (person.position.x, person.position.y, 0.0, 1.0)
        velocity = matrix @ (person.velocity.x, person.velocity.y, 0.0, 0.0)
        speed = math.hypot(velocity[0], velocity[1])
        turn = math.atan2(matrix[1, 0], matrix[0, 0])
        yaw = person.position.z + turn if speed < 0.09 else math.atan2(velocity[1], velocity[0])
        agents.append(
            {
                "id": id_,
                "group": group,
                "x": float(position[0]),
                "y": float(position[1]),
                "speed": speed,
                "yaw": math.remainder(yaw, 2 * math.pi),
                "omega": person.velocity.z,
            }
        )
    return agents


def read_cohan(message: Any, tf: Tf2Buffer, global_frame: str, now_ns: int) -> dict[int, F64]:
    """Return the agents' positions in the costmap's frame, by their numbers."""
    if now_ns - stamp_ns(message) > COHAN_OLD_NS:
        raise RefusalError("older than 0.1 s")
    found = {}
    rows = [None] * len(message.agents)  # path_vels_pos_ has one for each agent
    for agent in message.agents:
        if not 1 <= agent.track_id <= len(rows):
            raise RefusalError(f"path_vels_pos_[{agent.track_id - 1}] is beyond the end")
        torsos = [one for one in agent.segments if one.type == TORSO]
        if not torsos:
            raise RefusalError("no torso")
        orientation = torsos[0].pose.pose.orientation
        if abs(orientation.z**2 + orientation.w**2 - 1) > 1e-6:
            raise RefusalError("no quaternion of unit length")
        matrix = tf.lookup(global_frame, message.header.frame_id, stamp_ns(message))
        at = torsos[0].pose.pose.position
        found[int(agent.track_id)] = (matrix @ (at.x, at.y, at.z, 1.0))[:3]
    if len(found) < len(message.agents):
        raise RefusalError("two agents have one number")
    return found
