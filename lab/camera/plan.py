"""Plans of the camera: pose, path, image and depth sensor."""

from typing import Annotated

from msgspec import Meta

from common.config import Config
from lab.depth.config import SensorName
from people4d.messages.base import Name, NonNegative

RateHz = Annotated[float, Meta(ge=1, le=1000)]
CameraSide = Annotated[int, Meta(ge=16, le=4096)]  # [px]


class Drive(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Section of the robot's path, with smooth changes of speed and turn rate."""

    for_s: Annotated[float, Meta(ge=0.05)]  # [s] duration of the section
    speed_mps: Annotated[float, Meta(ge=-2, le=2)] = 0.0  # [m/s] forward
    turn_dps: Annotated[float, Meta(ge=-360, le=360)] = 0.0  # [deg/s] counter-clockwise


class ImagePlan(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Errors of a low-cost colour camera; none by default."""

    brightness: Annotated[float, Meta(ge=0.1, le=10)] = 1.0  # exposure relative to a correct one
    # [stops] standard deviation of the drift of automatic exposure
    exposure_stops: Annotated[float, Meta(ge=0, le=3)] = 0.0
    # standard deviation of the drift of the gains of red and blue
    white_balance: Annotated[float, Meta(ge=0, le=1)] = 0.0
    grain: Annotated[float, Meta(ge=0, le=20)] = 1.0  # noise relative to a sensor in good light
    blur_px: Annotated[float, Meta(ge=0, le=10)] = 0.0  # [px] standard deviation of defocus


class CameraPlan(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Camera, static or on a robot."""

    name: Annotated[Name, Meta(max_length=50)] = "front"  # name in keys and messages
    at: tuple[float, float, float] = (0.0, 0.0, 1.15)  # [m] x, y, z at the start, frame: map
    yaw_deg: float = 0.0  # [deg] yaw at the start, 0 = +x
    pitch_deg: Annotated[float, Meta(ge=-80, le=80)] = 3.0  # [deg] downward
    roll_deg: Annotated[float, Meta(ge=-45, le=45)] = 0.0  # [deg] right side down
    # True: people keep a distance, as from a robot; False: the camera is above their heads
    avoided: bool = True
    width: CameraSide = 640  # [px] width of images
    height: CameraSide = 480  # [px] height of images
    # [px] focal length in both directions; D435i, colour image of 640x480
    focal_px: Annotated[float, Meta(ge=10, le=10000)] = 615.0
    fps: Annotated[float, Meta(ge=1, le=120)] = 30.0  # [Hz] frame rate
    phase_s: NonNegative = 0.0  # [s] time of the first frame, less than 1 / fps
    clock_offset_s: float = 0.0  # [s] initial clock minus true time
    clock_drift_ppm: Annotated[float, Meta(ge=-1000, le=1000)] = 0.0  # growth of the clock offset
    exposure_s: NonNegative = 0.0  # [s] exposure time of motion blur; 0: none
    image: ImagePlan = ImagePlan()
    depth_sensor: SensorName = "d435i"  # depth errors, see `lab.depth.config.SENSORS`
    depth_lag_s: Annotated[float, Meta(ge=0, le=0.2)] = 0.0  # [s] delay of depth
    drive: tuple[Drive, ...] = ()  # path of the robot; empty: static camera

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
