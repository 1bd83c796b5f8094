"""One person's path over the floor: an agenda of positions, followed within human limits."""

import math
from collections.abc import Generator, Iterator

from common.geometry.transforms import wrap
from lab.scenario import PersonPlan, Waypoint

STEP_S = 0.01  # [s] of the simulation

ACCELERATION_MPS2 = 1.0
BRAKING_MPS2 = 1.2
COMFORTABLE_BRAKING_MPS2 = 0.6  # before a position to stop at
TURN_RATE_RADPS = 2.0
TURN_ACCELERATION_RADPS2 = 7.0
TURN_GAIN_HZ = 3.0  # turn rate for each radian still to turn

ARRIVED_M = 0.06  # at a position to stop at
PASSED_M = 0.35  # by a position in passing
FACED_RAD = math.radians(3.0)
GIVE_UP_S = 4.0  # without coming nearer, until an occupied position is given up

SIT_S = 1.9  # to sit down or to stand up
SEAT_HEIGHT_M = 0.45
SEAT_BEHIND = 0.215  # of the stature: from where a person stands back to the stool


class Walker:
    """State and goal of a person; advanced in steps of STEP_S.

    Attributes:
        x_m: Position, frame: map; with y_m.
        yaw_rad: Direction of facing and walking, frame: map, not wrapped.
        speed_mps: Forward.
        goal_m: Position to go to now, None while staying.
        face_rad: Yaw to turn to while staying, None to stay as is.
        cruise_mps: Speed of free walking to the goal.
        stopping: The goal is a position to stop at.
        seated: Progress of sitting down, 0 standing to 1 seated.
        looking: Looks around.
        stool_m: The stool that this person goes to or sits on, None without.
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
        """Bring goal, facing and pose up to date for a time."""
        self._time_s = time_s
        next(self._agenda)

    def bearing_rad(self) -> float:
        """Return the direction to the goal, or to face."""
        if self.goal_m is not None:
            return math.atan2(self.goal_m[1] - self.y_m, self.goal_m[0] - self.x_m)
        return self.yaw_rad if self.face_rad is None else self.face_rad

    def goal_distance_m(self) -> float:
        """Return how far the goal is; 0 without one."""
        if self.goal_m is None:
            return 0.0
        return math.hypot(self.goal_m[0] - self.x_m, self.goal_m[1] - self.y_m)

    def move(self, heading_rad: float, speed_mps: float) -> None:
        """Move for one step, towards a heading and a speed, as fast as a person can change them."""
        error = wrap(heading_rad - self.yaw_rad)
        wanted = max(-TURN_RATE_RADPS, min(TURN_RATE_RADPS, TURN_GAIN_HZ * error))
        change = TURN_ACCELERATION_RADPS2 * STEP_S
        self.turn_radps += max(-change, min(change, wanted - self.turn_radps))
        self.yaw_rad += self.turn_radps * STEP_S

        # A person who must turn far does so before walking on.
        speed_mps *= max(0.0, min(1.0, (1.55 - abs(error)) / 1.2))
        if self.stopping:
            rest = max(0.0, self.goal_distance_m() - ARRIVED_M / 2)
            speed_mps = min(speed_mps, math.sqrt(2 * COMFORTABLE_BRAKING_MPS2 * rest))
        faster, slower = ACCELERATION_MPS2 * STEP_S, BRAKING_MPS2 * STEP_S
        self.speed_mps += max(-slower, min(faster, speed_mps - self.speed_mps))
        self.x_m += self.speed_mps * math.cos(self.yaw_rad) * STEP_S
        self.y_m += self.speed_mps * math.sin(self.yaw_rad) * STEP_S

    def _follow_plan(self) -> Iterator[None]:
        """Live through the plan; one pause at each step of the simulation."""
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
        """Go to a waypoint and stay there as long as it says, for good at the last one."""
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
        """Go to a position; return True if it was reached, False if it was given up."""
        self.goal_m, self.face_rad = target, None
        nearest, nearest_s = math.inf, self._time_s
        while not self._arrived():
            distance = self.goal_distance_m()
            if distance < nearest - 0.1:
                nearest, nearest_s = distance, self._time_s
            if self._time_s - nearest_s > GIVE_UP_S:
                return False
            yield
        yield  # so that a path of reached positions ends no step too late
        return True

    def _arrived(self) -> bool:
        """Check that the goal is reached, or so near behind that going back would look odd."""
        distance = self.goal_distance_m()
        behind = math.cos(self.bearing_rad() - self.yaw_rad) < 0
        if self.stopping:
            return distance < ARRIVED_M or (behind and distance < 2 * ARRIVED_M)
        return distance < PASSED_M or (behind and distance < 1.5 * PASSED_M)

    def _stay(
        self, seconds: float, face_rad: float | None, sit: bool, turn_head: bool
    ) -> Iterator[None]:
        """Stop, turn to the wanted side, stay (and sit) until it is time to go on."""
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
