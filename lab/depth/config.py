"""The errors of a depth camera of two imagers, depth aligned to colour; Intel's RealSense D435i.

Such a camera matches the pictures of two imagers a baseline b apart. What it measures is the
disparity d = f b / z, so an error of s pixels in d is one of z^2 s / (f b) in z: the RMS error
grows with the square of the distance. Intel's guide to tuning the D400 series states this law, with
s below 0.1 px on well textured surfaces; the data sheet promises at most 2 % at 2 m, and a user who
put a D435 before a wall at 2.2 m reports s = 0.06 to 0.07 (librealsense, question 3139). The
defaults, s = 0.07 px, f = 385 px and b = 50 mm, give 3.6 mm at 1 m, 15 mm (0.7 %) at 2 m, 33 mm at
3 m and 58 mm (1.5 %) at 4 m.

How noise divides into smooth and white, frozen and running, and how ragged silhouettes are, is
chosen by eye, not measured on a camera. What is not simulated: texture (a white wall is matched as
well as a shirt), sunlight, glass and mirrors, rolling temperature drift.
"""

import math

import msgspec


class DepthSensorConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The errors of a depth camera; the defaults resemble a D435i in a room."""

    baseline_m: float = 0.050  # [m] between the imagers, the right one to the right; D435i: 50 mm
    focal_px: float = 385.0  # [px] of the imagers, whose disparity is measured; D435i at 640x480
    noise_px: float = 0.07  # [px] RMS error of disparity; measured 0.06 to 0.07 (see above)
    grain_share: float = 0.45  # of its variance that is smooth over `grain_px` (default by eye)
    patch_share: float = 0.25  # of its variance that is smooth over `patch_px`; the rest is white
    grain_px: int = 6  # [px] about the window in which imagers are matched
    patch_px: int = 18  # [px]
    step_px: float = 1 / 32  # [px] disparity is a multiple of this; D400: 1/32; 0: not rounded
    frozen_share: float = 0.35  # of the variance of all noise that never changes (by eye)
    correlation_s: float = 0.1  # [s] how long the other noise lasts, see `noise.Persistence`
    ragged_px: float = 1.2  # [px] RMS sideways error of silhouettes (by eye)
    ragged_cell_px: int = 4  # [px] size of the teeth of silhouettes
    shadow: bool = True  # no reading where the right imager's view is blocked
    shadow_gap_px: float = 1.0  # [px] of disparity that the blocking surface is nearer
    left_band: bool = True  # no reading left of the right imager's view, if as wide as colour's
    edge_gap: float = 0.04  # a step in depth of this share of the depth is an edge
    edge_holes: float = 0.4  # share of pixels at edges and beside shadows without reading (by eye)
    holes: float = 0.006  # share of other pixels without reading, in blobs: dark, shiny (by eye)
    hole_px: int = 9  # [px] size of the blobs
    grazing_tan: float = 8.0  # tangent of the angle of view at which half the readings fail
    min_depth_m: float = 0.28  # [m] nearer gives no reading; D435i
    max_depth_m: float = 5.0  # [m] farther gives no reading; as the paper cuts it
    scale_bias: float = 0.0  # readings are larger by this share, as after a bad calibration
    shift_px: tuple[float, float] = (0.0, 0.0)  # [px] of depth against colour: right, down

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            ValueError: A value is out of range.
        """
        for name in ("baseline_m", "focal_px", "correlation_s", "grazing_tan"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected > 0, got {getattr(self, name)}")
        for name in ("noise_px", "step_px", "ragged_px", "shadow_gap_px", "edge_gap"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected >= 0, got {getattr(self, name)}")
        for name in ("grain_share", "patch_share", "frozen_share", "edge_holes", "holes"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name}: expected 0 to 1, got {getattr(self, name)}")
        for name in ("grain_px", "patch_px", "ragged_cell_px", "hole_px"):
            if not 1 <= getattr(self, name) <= 256:
                raise ValueError(f"{name}: expected 1 to 256, got {getattr(self, name)}")
        if self.grain_share + self.patch_share > 1:
            raise ValueError("grain_share + patch_share: expected at most 1")
        if not 0 <= self.min_depth_m < self.max_depth_m <= 65.5:
            raise ValueError("min_depth_m, max_depth_m: expected 0 <= min < max <= 65.5")
        if not -0.5 < self.scale_bias < 0.5 or not max(map(abs, self.shift_px)) <= 64:
            raise ValueError("scale_bias: expected within 0.5; shift_px: within 64")

    def noise_m(self, depth_m: float) -> float:
        """Return the standard deviation of a reading at a depth, without rounding."""
        return depth_m**2 * self.noise_px / (self.focal_px * self.baseline_m)


EXACT = DepthSensorConfig(
    noise_px=0,
    step_px=0,
    ragged_px=0,
    shadow=False,
    left_band=False,
    edge_holes=0,
    holes=0,
    min_depth_m=0,
    max_depth_m=65.5,
)  # reads whole millimetres and makes no other error
