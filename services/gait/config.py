"""Configuration of the gait service.

Sections are those of docs/method.md. "Published" is the value of [Liu 2018]; values without a
source are this project's.
"""

from typing import Annotated, Literal

from msgspec import Meta

from common.config import Config
from people4d.messages.base import Count, NonNegative, Positive, PositiveInt, Ratio

Number = Annotated[int, Meta(ge=1, le=1000)]
Bins = Annotated[int, Meta(ge=1, le=256)]
Passes = Annotated[int, Meta(ge=0, le=100)]
BelowOne = Annotated[float, Meta(ge=0, lt=1)]
Reach = Annotated[float, Meta(ge=0, le=2)]
N = NonNegative
NoiseVector4 = tuple[N, N, N, N]
NoiseVector8 = tuple[N, N, N, N, N, N, N, N]
PUBLISHED_TAU: NoiseVector8 = (10.0, 10.0, 1.0, 1.0, 0.1, 0.1, 0.1, 0.1)  # section 8.1


class ColourLayerConfig(Config, frozen=True, kw_only=True):
    """Particle filter of a box by its colours (section 8.1)."""

    particles: Annotated[int, Meta(ge=1, le=100_000)] = 100  # for each person; published: 20 to 160
    # 8: [x, y, x', y', w, h, w', h'], pixels and pixels a frame; 4: the box keeps its size
    state: Literal[8, 4] = 8
    order: Literal[1, 2] = 1  # of the motion model
    sampling: Literal["plain", "hierarchical"] = "plain"  # hierarchical: section 8.1 (G 3.4)
    # [px, px a frame] noise, in the order of the state. With PUBLISHED_TAU the speed of the size is
    # a random walk that nothing damps
    tau: NoiseVector8 = (4.0, 3.0, 1.0, 0.5, 2.0, 4.0, 0.0, 0.0)
    # Likelihood of particles. distance: of their histogram to the first one, as published, which
    # does not distinguish a person from half of a person. ratio: section 19
    weights: Literal["ratio", "distance"] = "ratio"
    ratio_sigma: Positive = 0.05  # of ratio: of the mean logarithm over a box
    aspect_sigma: Positive = 0.15  # of ratio: of the logarithm of width by height, to the first box
    bands: Bins = 4  # of ratio: parts of the height, each with its own colours
    # Of ratio: width of the background about a box, in its widths
    background_scale: Annotated[float, Meta(gt=1, le=4)] = 1.6
    sigma: Positive = 0.1  # of distance; published: 1, which is nearly flat
    hue_bins: Bins = 20  # section 8.1
    saturation_bins: Bins = 20  # section 8.1
    points: tuple[Bins, Bins] = (12, 32)  # samples of a box, across and down, of any size
    box_min_px: Positive = 4.0  # [px] of a side
    # Hierarchical sampling: a and b have mean and variance 1, times these; published: 1 for both,
    # with which a box doubles within a second
    growth_sideways_px2: NonNegative = 0.02  # [px^2 a frame^3] of a / |x'|
    growth_upright: NonNegative = 0.005  # [1 a frame] of b y'
    speed_min_px: Positive = 1.0  # [px a frame] least |x'|, and least speed that has a direction
    along_share: Ratio = 0.5  # of particles that are sampled along the motion
    along_stretch: Positive = 1.4  # of their noise along it, and its inverse across


class BodyConfig(Config, frozen=True, kw_only=True):
    """Segmentation of a body in a box of the depth image, and its mesh (section 8.2).

    The published thresholds, 10 mm between pixels and 15 mm between vertices, are of a time of
    flight camera at 2 to 3 m. Here they are minima; both grow with the distance, as the pixels'
    spacing does, and with the square of it, as a stereo camera's noise does.
    """

    fill_passes: Passes = 2  # of hole filling; published: 1
    fill_neighbours: Annotated[int, Meta(ge=1, le=8)] = 3  # of 8 that have depth; published: 1
    continuity_m: NonNegative = 0.010  # [m] between neighbouring pixels of one component
    continuity_per_m: NonNegative = 0.006  # [m/m] its minimum by the distance
    noise_per_m2: NonNegative = 0.0025  # [m/m^2] of neighbouring readings, by the distance squared
    noise_sigmas: NonNegative = 3.0  # how much of it counts; 0 for a camera without
    seed_window_m: NonNegative = 0.25  # [m] about the track's depth, that votes for the component
    reach_m: NonNegative = 1.0  # [m] farthest part of a person from the track's depth
    # [m] gap to a part that is occluded at its joint, as the far leg by the near one; 0, as
    # published: parts that are not connected are left out
    join_m: NonNegative = 0.4
    join_px: Passes = 4  # [px] farthest such part beside the body
    pixels_min: Count = 30  # of a body and of a joined part
    vertices: Count = 3000  # of a mesh, at most about; 0: one for each pixel
    edge_m: NonNegative = 0.015  # [m] between neighbouring vertices; section 8.2
    # [px] about a vertex within which depth is averaged: the residual noise of a stereo camera is
    # longer than the edges and would lengthen all paths along the surface; published: 0
    smooth_px: Passes = 6
    edge_stretch: NonNegative = 2.0  # times the spacing of a surface at right angles to the ray
    edge_noise_per_m2: NonNegative = 0.003  # [m/m^2] of vertices, by the distance squared
    # Range of the neck, in heights of the body from its top; published: from 0
    neck_rows: tuple[Ratio, Ratio] = (0.06, 1 / 3)
    # [heads] from the top of the head [Winter 2009]: neck at 0.87, shoulders at 0.82, hips at 0.53
    # of the stature
    shoulders_heads: Annotated[float, Meta(ge=1)] = 1.5  # to the beginning of the torso
    hips_heads: Annotated[float, Meta(ge=1)] = 3.6  # to the beginning of the legs
    normal_passes: Passes = 1  # of averaging normals with their neighbours'; published: 0

    def __post_init__(self) -> None:
        """Check ranges and order."""
        super().__post_init__()
        if self.neck_rows[0] >= self.neck_rows[1]:
            raise ValueError(f"neck_rows: expected first < second, got {self.neck_rows}")
        if self.shoulders_heads > self.hips_heads:
            raise ValueError(
                "shoulders_heads, hips_heads: expected first <= second, got "
                f"{self.shoulders_heads}, {self.hips_heads}"
            )


class FloorConfig(Config, frozen=True, kw_only=True):
    """Detection and removal of the floor (section 19)."""

    cut: bool = True  # remove the floor from bodies
    height_m: BelowOne = 0.035  # [m] above the floor up to which pixels belong to it
    noise_per_m2: BelowOne = 0.0025  # [m/m^2] depth noise by distance squared, times two
    tilt_max_deg: Annotated[float, Meta(gt=0, lt=90)] = 40.0  # [deg] of the camera
    every: PositiveInt = 10  # frames between detections
    stride_px: PositiveInt = 8  # [px] between sampled pixels
    share_min: BelowOne = 0.08  # of the samples on it
    below_max: BelowOne = 0.04  # of the samples below it; more: it is a table


class SpinConfig(Config, frozen=True, kw_only=True):
    """Spin images and their similarity (section 8.3)."""

    bins: Annotated[int, Meta(ge=2, le=128)] = 20  # across and down; section 8.3
    # [m] of a bin. Published: 1 to 2 times the mesh's resolution, but that changes with the
    # distance, and images are compared over time; 0: bin_resolutions times the resolution
    bin_m: NonNegative = 0.02
    bin_resolutions: Positive = 1.5  # where bin_m is 0
    # [deg] largest angle between normals; published: 60 to 90
    support_angle_deg: Annotated[float, Meta(gt=0, le=180)] = 75.0
    points: Count = 1000  # vertices that are counted, at most; 0: all
    overlap_min: Annotated[int, Meta(ge=4)] = 10  # bins filled in both images; fewer: no match


class DepthLayerConfig(Config, frozen=True, kw_only=True):
    """Particle filters of points on a body (sections 8.3 and 19)."""

    # Likelihood of particles. spin, geodesic: one feature, as published. combined: both, with
    # extremities, motion and keypoints, each weighted by its own confidence
    feature: Literal["combined", "spin", "geodesic"] = "combined"
    # Tracked points: those of `keypoints.POINTS`; marked ones are added
    points: tuple[str, ...] = ("head", "left_hand", "right_hand", "left_foot", "right_foot")
    particles: Annotated[int, Meta(ge=2, le=10_000)] = 60  # of each point; published: 60 and 100
    # [px, px a frame] noise of x, y, x', y'; section 8.1. combined: of a person 3 m away with a
    # focal length of 615 px
    tau: NoiseVector4 = (10.0, 10.0, 1.0, 1.0)
    source: Literal["head", "body"] = "head"  # of geodesic distances; combined: always the torso
    geodesic_sigma_m: Positive = 0.08  # [m] of a geodesic distance to the initial one
    spin: SpinConfig = SpinConfig()
    spin_sigma: Positive = 1.5  # of the similarity of spin images
    keypoints: bool = True  # combined: use the keypoints of the detector

    # All below: combined only
    keypoint_sigma_m: Positive = 0.04  # [m] of a keypoint, at right angles to the ray
    keypoint_confidence_min: BelowOne = 0.4
    hand_reach: Reach = 0.5  # of the forearm, from the wrist to the middle of the hand
    foot_reach: Reach = 0.12  # of the shank, from the ankle to the middle of the foot
    foot_ahead_m: Positive = 0.07  # [m] from the ankle ahead to the middle of the foot
    persistence_m: Positive = 0.06  # [m] least persistence of an extremity
    hand_m: Positive = 0.09  # [m] along the body from the fingertips to the middle of the hand
    foot_m: Positive = 0.10  # [m] from the toes to the middle of the foot
    head_m: Positive = 0.17  # [m] from the top of the head, round it, to its middle
    extremity_sigma_m: Positive = 0.04  # [m] of these three
    window_m: Positive = 0.06  # [m] about the best particle, over which an estimate is averaged
    acceleration_mps2: Positive = 12.0  # [m/s^2] of hands and feet, standard deviation
    noise_m: Positive = 0.015  # [m] of a measured position, at right angles to the ray
    noise_per_m2: Positive = 0.004  # [m/m^2] of it in depth, by the distance squared
    confidence_min: BelowOne = 0.25  # of a measured position
    timeout_s: Positive = 0.4  # [s] without a measurement until a point is lost
    body_prior: bool = True  # hands and feet are expected beside and below the body
    hidden_s: Positive = 1.5  # [s] the same of a point whose body is visible
    spread_max_m: Positive = 0.35  # [m] largest standard deviation of a predicted point
    # [m] standard deviation, as published, from which on a predicted hand or foot is lost
    vague_m: Positive = 0.17
    swap_s: Positive = 0.15  # [s] that left and right must contradict the heading to be exchanged
    gate: Positive = 5.0  # [standard deviations] from its prediction that a point is accepted
    proposal_ratio: Positive = 0.4  # of particles that are drawn from keypoints and extremities
    adaptation: Positive = 0.03  # of the reference distance, by each measured frame
    adaptation_max_m: Positive = 0.10  # [m] in all

    def __post_init__(self) -> None:
        """Check ranges and names."""
        super().__post_init__()
        if len(set(self.points)) < len(self.points) or not all(self.points):
            raise ValueError(f"points: expected different names, got {self.points}")


class CascadeConfig(Config, frozen=True, kw_only=True):
    """From boxes and depth to the points of people (section 8)."""

    colour: ColourLayerConfig = ColourLayerConfig()  # tracks boxes between detections
    body: BodyConfig = BodyConfig()
    floor: FloorConfig = FloorConfig()
    depth: DepthLayerConfig = DepthLayerConfig()
    seed: int = 0  # of all random numbers
    # People whose depth is processed in one frame, in turn, which bounds the time; the points of
    # the others are predicted
    people_max: PositiveInt = 6
    box_margin: Ratio = 0.06  # of a box's height, by which it is widened: it may miss a hand
    colour_margin: Ratio = 0.12  # the same of a box of the colour layer
    colour_distance_max: Ratio = 0.6  # of a box of the colour layer, Bhattacharyya
    carry_s: Positive = 2.0  # [s] that the colour layer tracks a box without a detection
    forget_s: Positive = 2.0  # [s] without an observation, after which a person is deleted
    gap_s: Positive = 1.0  # [s] between frames, after which points are lost
    details: bool = False  # estimates contain meshes and particles, to be drawn


class StepConfig(Config, frozen=True, kw_only=True):
    """Detection of steps and gait measures (section 20)."""

    window_s: Positive = 8.0  # [s] of the past that measures are of
    every_s: Positive = 0.2  # [s] between computations of measures
    strides_min: PositiveInt = 1  # strides without pauses in the window, each of three steps
    speed_min_mps: Positive = 0.2  # [m/s] below it a person stands
    length_min_m: Positive = 0.2  # [m] of a step
    step_min_s: Positive = 0.25  # [s] shorter ones are noise
    step_max_s: Positive = 1.5  # [s] longer ones are pauses
    stance_min_s: Positive = 0.15  # [s] least time that a foot stands
    stance_max_s: Positive = 2.0  # [s] longest stance that is looked for; longer ones are joined
    swing_cost: Positive = 3.0  # squared deviation from standing, from which on a foot swings
    step_confidence_min: Ratio = 0.3  # of a reported step
    noise_m: Positive = 0.06  # [m] of a standing foot, besides the noise of its point
    gap_s: Positive = 0.5  # [s] a foot may be hidden in a swing
    time_spread: Positive = 0.5  # of a stride's time from the median one, relative; else a pause

    def __post_init__(self) -> None:
        """Check ranges and order."""
        super().__post_init__()
        if self.step_min_s >= self.step_max_s:
            raise ValueError(
                f"step_min_s: expected below step_max_s, got {self.step_min_s}, {self.step_max_s}"
            )


class GaitConfig(Config, frozen=True, kw_only=True):
    """Configuration of the gait service."""

    people_max: Number = 32  # of one camera, the nearest; cascade.people_max bounds the time
    # Frames of all cameras that wait for their tracks: enough for the latency of the pipeline,
    # 1.5 MB each with 640x480 pixels
    frames: Number = 16
    settle_s: BelowOne = 0.003  # [s] that a frame waits for a newer one of its camera
    clock_jump_s: Positive = 1.0  # [s] a stamp this far back begins a new time; nearer, it is stale
    cascade: CascadeConfig = CascadeConfig()
    steps: StepConfig = StepConfig()
