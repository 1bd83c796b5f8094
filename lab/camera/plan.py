"""Plans of the camera: its pose and path, its image and its depth sensor."""

from typing import Annotated

from msgspec import Meta

from common.config import Config
from lab.depth.config import SensorName
from people4d.messages.base import Name, NonNegative, Positive

RateHz = Annotated[float, Meta(ge=1, le=1000)]
RelativeError = Annotated[float, Meta(ge=-0.5, le=0.5)]
CameraSide = Annotated[int, Meta(ge=16, le=4096)]  # [px]


class Drive(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A stretch of the robot's path; speed and turn change smoothly from one to the next."""

    for_s: Annotated[float, Meta(ge=0.05)]  # [s]
    speed_mps: Annotated[float, Meta(ge=-2, le=2)] = 0.0  # [m/s] forward
    turn_dps: Annotated[float, Meta(ge=-360, le=360)] = 0.0  # [deg/s] counter-clockwise


class WheelPlan(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The wheel encoders of the robot."""

    rate_hz: RateHz = 50.0  # [Hz]
    radius_m: Annotated[float, Meta(ge=0.005, le=1)] = 0.0325  # [m] of each wheel
    track_m: Annotated[float, Meta(ge=0.01, le=5)] = 0.30  # [m] between the wheels
    ticks_per_turn: Annotated[int, Meta(ge=1, le=2**31)] = 4096  # of a wheel
    scale_error: RelativeError = 0.01  # of the radius, both wheels alike
    track_error: RelativeError = 0.01  # of the wheel track: turns come out too large
    # standard deviation of each wheel's relative slip, drawn anew every second
    slip: Annotated[float, Meta(ge=0, le=0.5)] = 0.02


class ImagePlan(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Weaknesses of a plain colour camera; by default there are none."""

    brightness: Annotated[float, Meta(ge=0.1, le=10)] = 1.0  # of a right exposure: above 1 too long
    # [stops] standard deviation of the exposure, which drifts as of an automatic one
    exposure_stops: Annotated[float, Meta(ge=0, le=3)] = 0.0
    # standard deviation of the gains of red and of blue, which drift likewise
    white_balance: Annotated[float, Meta(ge=0, le=1)] = 0.0
    drift_s: Positive = 3.0  # [s] in which both have drifted to other values
    grain: Annotated[float, Meta(ge=0, le=20)] = 1.0  # noise over that of a sensor in good light
    blur_px: Annotated[float, Meta(ge=0, le=10)] = 0.0  # [px] standard deviation: out of focus


class CameraPlan(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The camera; on a robot if it drives."""

    name: Name = "front"
    at: tuple[float, float, float] = (0.0, 0.0, 1.15)  # [m] x, y, z at the start, frame: map
    yaw_deg: float = 0.0  # [deg] at the start, 0 = +x
    pitch_deg: Annotated[float, Meta(ge=-80, le=80)] = 3.0  # [deg] downward
    roll_deg: Annotated[float, Meta(ge=-45, le=45)] = 0.0  # [deg] right side down
    # people keep away from it, as from a robot; false: it hangs above their heads
    avoided: bool = True
    width: CameraSide = 640  # [px]
    height: CameraSide = 480  # [px]
    # [px] both directions, as a D435i's colour image of 640x480
    focal_px: Annotated[float, Meta(ge=10, le=10000)] = 615.0
    fps: Annotated[float, Meta(ge=1, le=120)] = 30.0  # [Hz]
    phase_s: NonNegative = 0.0  # [s] of the first frame, less than 1 / fps
    clock_offset_s: float = 0.0  # [s] its clock minus the true time, at the start
    clock_drift_ppm: Annotated[float, Meta(ge=-1000, le=1000)] = 0.0  # growth of that offset
    exposure_s: NonNegative = 0.0  # [s] shutter time that blurs motion; 0: none
    image: ImagePlan = ImagePlan()
    depth_sensor: SensorName = "d435i"  # whose errors depth has, see `lab.depth.config.SENSORS`
    depth_lag_s: Annotated[float, Meta(ge=0, le=0.2)] = 0.0  # [s] by which depth is older
    drive: tuple[Drive, ...] = ()  # the robot's path; empty: the camera stands still
    wheels: WheelPlan = WheelPlan()

    def __post_init__(self) -> None:
        """Check the exposure and the phase against the frame rate."""
        super().__post_init__()
        if self.exposure_s > 1 / self.fps:
            raise ValueError(f"exposure_s: expected <= {1 / self.fps}, got {self.exposure_s}")
        if self.phase_s >= 1 / self.fps:
            raise ValueError(f"phase_s: expected < {1 / self.fps}, got {self.phase_s}")

    def clock_s(self, t_s: float) -> float:
        """Return the time on the camera's clock [s] at a true time since the beginning."""
        return t_s + self.clock_offset_s + self.clock_drift_ppm * 1e-6 * t_s

    def true_s(self, clock_s: float) -> float:
        """Return the true time [s] of a time on the camera's clock."""
        return (clock_s - self.clock_offset_s) / (1 + self.clock_drift_ppm * 1e-6)
