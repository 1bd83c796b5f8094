"""Errors of a stereo depth camera, depth aligned to colour: Intel RealSense D435i.

The camera matches the images of two imagers with a baseline b. It measures the disparity
d = f b / z, so an error of s pixels in d is an error of z^2 s / (f b) in z: the RMS error grows
with the square of the distance. [Grunnet-Jepsen] states this law, with s below 0.1 px on well
textured surfaces; the data sheet promises at most 2 % at 2 m, and s = 0.06 to 0.07 was measured on
a wall at 2.2 m [librealsense 3139]. The defaults, s = 0.07 px, f = 385 px and b = 50 mm, give
3.6 mm at 1 m, 15 mm (0.7 %) at 2 m, 33 mm at 3 m and 58 mm (1.5 %) at 4 m; docs/method.md
section 22.

The shares of smooth, white and constant noise and the raggedness of silhouettes are chosen by eye,
not measured on a camera. Not simulated: texture (a white wall is matched as well as a shirt),
sunlight, glass, mirrors and drift with temperature.
"""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from common.config import Config
from people4d.errors import ConfigError
from people4d.messages.base import NonNegative, Positive, Ratio

CellPx = Annotated[int, Meta(ge=1, le=256)]  # [px]
DepthLimit = Annotated[float, Meta(ge=0, le=65.5)]  # [m]
ShiftPx = Annotated[float, Meta(ge=-64, le=64)]  # [px]
ScaleBias = Annotated[float, Meta(gt=-0.5, lt=0.5)]


class DepthSensorModel(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Errors of a depth camera, as stored in recordings; the defaults are a D435i in a room."""

    baseline_m: Positive = 0.050  # [m] baseline of the imagers; D435i: 50 mm
    focal_px: Positive = 385.0  # [px] focal length of the imagers; D435i at 640x480
    noise_px: NonNegative = 0.07  # [px] RMS error of disparity; measured 0.06 to 0.07 (see above)
    grain_share: Ratio = 0.45  # share of the variance smooth over `grain_px` (by eye)
    patch_share: Ratio = 0.25  # share of the variance smooth over `patch_px`; the rest is white
    grain_px: CellPx = 6  # [px] size of fine smooth noise, about the matching window
    patch_px: CellPx = 18  # [px] size of coarse smooth noise
    step_px: NonNegative = 1 / 32  # [px] step of disparity; D400: 1/32; 0: continuous
    frozen_share: Ratio = 0.35  # share of the variance of noise that is constant (by eye)
    correlation_s: Positive = 0.1  # [s] correlation time of the other noise
    ragged_px: NonNegative = 1.2  # [px] RMS sideways error of silhouettes (by eye)
    ragged_cell_px: CellPx = 4  # [px] size of the teeth of silhouettes
    shadow: bool = True  # True: no reading where the right imager is occluded
    shadow_gap_px: NonNegative = 1.0  # [px] minimum disparity of the occluding surface
    left_band: bool = True  # True: no reading left of the right imager's view
    edge_gap: NonNegative = 0.04  # minimum step of depth at an edge, relative to depth
    edge_holes: Ratio = 0.4  # share of pixels at edges without reading (by eye)
    holes: Ratio = 0.006  # share of other pixels without reading, in blobs (by eye)
    hole_px: CellPx = 9  # [px] size of the blobs
    grazing_tan: Positive = 8.0  # tangent of the angle of view at which half of the readings fail
    min_depth_m: DepthLimit = 0.28  # [m] minimum depth; D435i
    max_depth_m: DepthLimit = 5.0  # [m] maximum depth; as in [PIC4SeR]
    # relative error of all readings, as after a bad calibration
    scale_bias: ScaleBias = 0.0
    shift_px: tuple[ShiftPx, ShiftPx] = (0.0, 0.0)  # [px] shift of depth: right, down
    # [m] position of the depth imager right of the colour camera, to which readings are registered;
    # 0: depth is measured in the view of the colour camera
    colour_offset_m: Annotated[float, Meta(ge=-0.2, le=0.2)] = 0.0
    # [1/m2] minimum infrared light of a reading: reflectance times the cosine of the angle of view
    # over the squared distance; 0: all surfaces are measured
    signal_least: NonNegative = 0.0

    def __post_init__(self) -> None:
        """Check shares and limits against each other."""
        if self.grain_share + self.patch_share > 1:
            raise ValueError("grain_share + patch_share: expected at most 1")
        if not self.min_depth_m < self.max_depth_m:
            raise ValueError("min_depth_m, max_depth_m: expected min < max")

    def noise_m(self, depth_m: float) -> float:
        """Return the standard deviation of a reading at a depth, without rounding."""
        return depth_m**2 * self.noise_px / (self.focal_px * self.baseline_m)

    @property
    def sees_surfaces(self) -> bool:
        """True: readings depend on more than depth in the view of the colour camera."""
        return self.colour_offset_m != 0.0 or self.signal_least > 0.0


class SensorChanges(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Changes of the errors of a depth camera; None: no change."""

    noise_px: NonNegative | None = None  # [px] RMS error of disparity
    holes: Ratio | None = None  # share of pixels without reading
    min_depth_m: DepthLimit | None = None  # [m] minimum depth
    max_depth_m: DepthLimit | None = None  # [m] maximum depth
    scale_bias: ScaleBias | None = None  # relative error of all readings
    shift_px: tuple[ShiftPx, ShiftPx] | None = None  # [px] shift of depth: right, down

    def change_model(self, model: DepthSensorModel) -> DepthSensorModel:
        """Return a model with the changes; ConfigError if the limits of depth contradict."""
        changes = {k: v for k, v in msgspec.structs.asdict(self).items() if v is not None}
        try:
            return msgspec.structs.replace(model, **changes)
        except ValueError as error:
            raise ConfigError(f"the depth sensor cannot be changed: {error}") from error


SensorName = Literal["d435i", "xtion"]
# xtion: an infrared projector 75 mm to the right of the imager (f = 575 px), 1/8 px steps, as in
# Kinect and Xtion. [Khoshelham 2012] measured a standard deviation of 1.4 mm z^2 (0.06 px). The
# matching window has about nine pixels, so silhouettes are blunt. In a recording of an Xtion, steps
# at 2 m and 4 m are 1/8 px. Left of near surfaces, readings are missing at 0.90 of the edges with
# steps in disparity above 9 px and at 0.24 of the edges below 7 px; right of them at 0.07 to 0.28.
# Registration to colour opens 2 px there, as with an imager 25 mm to the left. Limits of infrared
# light: by eye.
SENSORS: dict[SensorName, DepthSensorModel] = {
    "d435i": DepthSensorModel(),
    "xtion": DepthSensorModel(
        baseline_m=0.075,
        focal_px=575.0,
        noise_px=0.06,
        grain_share=0.7,
        patch_share=0.2,
        grain_px=9,
        step_px=1 / 8,
        ragged_px=1.5,
        ragged_cell_px=7,
        shadow_gap_px=7.0,
        edge_holes=0.15,
        holes=0.002,
        grazing_tan=12.0,
        min_depth_m=0.5,
        max_depth_m=9.0,
        shift_px=(-1.5, 1.0),
        colour_offset_m=-0.025,
        signal_least=0.004,
    ),
}
