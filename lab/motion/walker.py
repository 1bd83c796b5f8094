"""Path of one person over the floor: an agenda of positions, followed within human limits."""

import math
from collections.abc import Generator, Iterator

from common.geometry.transforms import wrap
from lab.scenario import PersonPlan, Waypoint

STEP_S = 0.01  # step of the simulation [s]

ACCELERATION_MPS2 = 1.0
BRAKING_MPS2 = 1.2
COMFORTABLE_BRAKING_MPS2 = 0.6  # deceleration before a stop [m/s^2]
TURN_RATE_RADPS = 2.0
TURN_ACCELERATION_RADPS2 = 7.0
TURN_GAIN_HZ = 3.0  # ratio of turn rate to remaining turn [1/s]

ARRIVED_M = 0.06  # tolerance of a position with a stop [m]
PASSED_M = 0.35  # tolerance of a position without a stop [m]
FACED_RAD = math.radians(3.0)  # tolerance of the yaw during a stop [rad]
GIVE_UP_S = 4.0  # time without approach after which a position is given up [s]

SIT_S = 1.9  # duration of sitting down and of standing up [s]
SEAT_HEIGHT_M = 0.45  # height of a stool [m]
SEAT_BEHIND = 0.215  # distance of the stool behind a standing person, relative to the stature


class Walker:
    """State and goal of a walking person, in steps of STEP_S.

    Attributes:
        x_m: Position, frame: map; with y_m.
        yaw_rad: Yaw of body and path, frame: map, not wrapped.
        speed_mps: Forward speed.
        goal_m: Next position; None during a stop.
        face_rad: Wanted yaw during a stop; None: no turn.
        cruise_mps: Speed of free walking to the goal.
        stopping: True: the person stops at the goal.
        seated: Progress of sitting down, 0 standing to 1 seated.
        looking: True while the person looks around.
        stool_m: Stool in use or approached; None: no stool.
    """

    def __init__(self, plan: PersonPlan, stature_m: float):
        self.x_m, self.y_m = plan.start
        self.yaw_rad = math.radians(plan.face_deg)
        self.speed_mps = self.turn_radps = 0.0
        self.goal_m: tuple[float, float] | None = None
        self.face_rad: float | None = None
        self.cruise_mps = plan.speed_mps
        self.stopping = self.looking = False
        self.seated = 0.0
        self.stool_m: tuple[float, float] | None = None
        self._plan, self._stature_m = plan, stature_m
        self._time_s = 0.0
        self._agenda = self._follow_plan()

    def decide(self, time_s: float) -> None:
        """Update the goal at a time."""
        self._time_s = time_s
        next(self._agenda)

    def bearing_rad(self) -> float:
        """Return the direction to the goal, or the wanted yaw during a stop."""
        if self.goal_m is not None:
            return math.atan2(self.goal_m[1] - self.y_m, self.goal_m[0] - self.x_m)
        return self.yaw_rad if self.face_rad is None else self.face_rad

    def goal_distance_m(self) -> float:
        """Return the distance of the goal; 0 during a stop."""
        if self.goal_m is None:
            return 0.0
        return math.hypot(self.goal_m[0] - self.x_m, self.goal_m[1] - self.y_m)

    def move(self, heading_rad: float, speed_mps: float) -> None:
        """Move for one step, towards a yaw and a speed, with limited accelerations."""
        error = wrap(heading_rad - self.yaw_rad)
        wanted = max(-TURN_RATE_RADPS, min(TURN_RATE_RADPS, TURN_GAIN_HZ * error))
        change = TURN_ACCELERATION_RADPS2 * STEP_S
        self.turn_radps += max(-change, min(change, wanted - self.turn_radps))
        self.yaw_rad += self.turn_radps * STEP_S

        # Large turns come before walking.
        speed_mps *= max(0.0, min(1.0, (1.55 - abs(error)) / 1.2))
        if self.stopping:
            rest = max(0.0, self.goal_distance_m() - ARRIVED_M / 2)
            speed_mps = min(speed_mps, math.sqrt(2 * COMFORTABLE_BRAKING_MPS2 * rest))
        faster, slower = ACCELERATION_MPS2 * STEP_S, BRAKING_MPS2 * STEP_S
        self.speed_mps += max(-slower, min(faster, speed_mps - self.speed_mps))
        self.x_m += self.speed_mps * math.cos(self.yaw_rad) * STEP_S
        self.y_m += self.speed_mps * math.sin(self.yaw_rad) * STEP_S

    def _follow_plan(self) -> Iterator[None]:
        """Follow the plan; yield at each step of the simulation."""
        while self._time_s < self._plan.wait_s:
            yield
        while self._plan.path:
            for waypoint in self._plan.path:
                last = not self._plan.repeat and waypoint is self._plan.path[-1]
                yield from self._visit(waypoint, last)
            if not self._plan.repeat:
                break
        while True:
            yield

    def _visit(self, waypoint: Waypoint, last: bool) -> Iterator[None]:
        """Go to a waypoint and make its stop, which has no end at the last waypoint."""
        face_rad = None if waypoint.face_deg is None else math.radians(waypoint.face_deg)
        target = waypoint.to
        if waypoint.sit:
            if face_rad is None:
                face_rad = math.atan2(self.y_m - target[1], self.x_m - target[0])
            self.stool_m, distance = target, SEAT_BEHIND * self._stature_m
            x_m, y_m = distance * math.cos(face_rad), distance * math.sin(face_rad)
            target = (target[0] + x_m, target[1] + y_m)
        self.cruise_mps = waypoint.speed_mps or self._plan.speed_mps
        self.stopping = last or waypoint.stop_s > 0 or waypoint.sit
        reached = yield from self._go(target)
        if self.stopping:
            seconds = math.inf if last and waypoint.stop_s == 0 else waypoint.stop_s
            sit = waypoint.sit and reached
            yield from self._stay(seconds, face_rad, sit, waypoint.turn_head)
        self.stool_m = None

    def _go(self, target: tuple[float, float]) -> Generator[None, None, bool]:
        """Go to a position; return True if it is reached, False if it is given up."""
        self.goal_m, self.face_rad = target, None
        nearest, nearest_s = math.inf, self._time_s
        while not self._arrived():
            distance = self.goal_distance_m()
            if distance < nearest - 0.1:
                nearest, nearest_s = distance, self._time_s
            if self._time_s - nearest_s > GIVE_UP_S:
                return False
            yield
        yield  # each reached position takes at least one step
        return True

    def _arrived(self) -> bool:
        """Check that the goal is reached, or passed at a small distance."""
        distance = self.goal_distance_m()
        behind = math.cos(self.bearing_rad() - self.yaw_rad) < 0
        if self.stopping:
            return distance < ARRIVED_M or (behind and distance < 2 * ARRIVED_M)
        return distance < PASSED_M or (behind and distance < 1.5 * PASSED_M)

    def _stay(
        self, seconds: float, face_rad: float | None, sit: bool, turn_head: bool
    ) -> Iterator[None]:
        """Stop, turn to the wanted yaw, and stay or sit for a duration."""
        self.goal_m, self.face_rad = None, face_rad
        leave_s = self._time_s + seconds
        while self.speed_mps > 0.01 or abs(wrap(self.bearing_rad() - self.yaw_rad)) > FACED_RAD:
            yield
        self.looking = turn_head
        rise_s = leave_s - (SIT_S if sit else 0.0)
        while self._time_s < rise_s:
            self.seated = min(1.0, self.seated + STEP_S / SIT_S) if sit else 0.0
            yield
        self.looking = False
        while self.seated > 0.0:
            self.seated = max(0.0, self.seated - STEP_S / SIT_S)
            yield
