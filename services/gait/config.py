"""Configuration of the gait service.

Sections refer to docs/method.md. "Published" is the value of [Liu 2018]; values without a
source are set by this project. All other constants are next to their equations.
"""

from typing import Annotated, Literal

from msgspec import Meta

from common.config import Config
from people4d.messages.base import NonNegative, Positive, Ratio

Number = Annotated[int, Meta(ge=1, le=1000)]
N = NonNegative
NoiseVector8 = tuple[N, N, N, N, N, N, N, N]
# Detection model with float32 keypoints, which show more steps in turns than int8 keypoints
# (benchmarks/gait_bodies.md)
POINTS_MODEL = "movenet-multipose"
PUBLISHED_TAU: NoiseVector8 = (10.0, 10.0, 1.0, 1.0, 0.1, 0.1, 0.1, 0.1)  # section 8.1


class ColourLayerConfig(Config, frozen=True, kw_only=True):
    """Particle filter of a box by its colours (section 8.1)."""

    # Number of particles of each person; published: 20 to 160
    particles: Annotated[int, Meta(ge=1, le=100_000)] = 100
    # 8: [x, y, x', y', w, h, w', h'], [px] and [px a frame]; 4: constant size of the box
    state: Literal[8, 4] = 8
    order: Literal[1, 2] = 1  # order of the motion model
    sampling: Literal["plain", "hierarchical"] = "plain"  # hierarchical: section 8.1 (G 3.4)
    # Noise in the order of the state [px, px a frame]. With PUBLISHED_TAU the speed of the size is
    # a random walk without damping
    tau: NoiseVector8 = (4.0, 3.0, 1.0, 0.5, 2.0, 4.0, 0.0, 0.0)
    # Likelihood of particles. distance: distance between their histogram and the first one, as
    # published; half of a person fits as well. ratio: section 19
    weights: Literal["ratio", "distance"] = "ratio"
    # Standard deviation of the distance; published: 1, which makes the likelihood nearly flat
    sigma: Positive = 0.1


class DepthLayerConfig(Config, frozen=True, kw_only=True):
    """Points on a body (sections 8.3 and 19)."""

    # spin, geodesic: particle filters by one feature, as published. combined: Kalman filters by
    # keypoints, ends of limbs and the expected body
    feature: Literal["combined", "spin", "geodesic"] = "combined"
    # Particles of each point with one feature; published: 60 and 100
    particles: Annotated[int, Meta(ge=2, le=10_000)] = 60
    keypoints: bool = True  # combined: use the keypoints of the detector


class CascadeConfig(Config, frozen=True, kw_only=True):
    """From boxes and depth to the points of people (section 8)."""

    colour: ColourLayerConfig = ColourLayerConfig()  # tracks boxes between detections
    depth: DepthLayerConfig = DepthLayerConfig()
    seed: int = 0  # seed of all random numbers
    # Maximum Bhattacharyya distance of a box of the colour layer to the first one
    colour_distance_max: Ratio = 0.6
    carry_s: Positive = 2.0  # Maximum age of the last detection for a box of the colour layer [s]


class StepConfig(Config, frozen=True, kw_only=True):
    """Period and rate of the gait measures (section 20)."""

    window_s: Positive = 8.0  # Period that the measures cover [s]
    every_s: Positive = 0.2  # Period between computations of the measures [s]


class GaitConfig(Config, frozen=True, kw_only=True):
    """Configuration of the gait service."""

    # Maximum number of people of one camera, nearest first; bounds the time of a frame
    people_max: Number = 6
    # Frames of all cameras that wait for their tracks: enough for the latency of the pipeline,
    # 1.5 MB each with 640x480 pixels
    frames: Number = 16
    cascade: CascadeConfig = CascadeConfig()
    steps: StepConfig = StepConfig()
