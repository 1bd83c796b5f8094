"""Configuration of StrongSORT-3D and the policies around it.

Presets hold the published constants. Sections are sections of docs/method.md; values without a
source are set by this project.
"""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from common.config import Config
from people4d.messages.base import Positive, PositiveInt

CosineDistance = Annotated[float, Meta(gt=0, le=2)]

# Maximum cosine distances in round 1, measured like common.appearance.REIDENTIFICATION_MAX
COSINE_DISTANCE_MAX = {"appearance": 0.46, "histogram": 0.25, "osnet": 0.45}
COSINE_DISTANCE_MAX_OTHER = 0.3


class IdentityConfig(Config, frozen=True, kw_only=True):
    """Re-identification of returning people."""

    enabled: bool = True  # section 5: False
    retention_s: Positive = 600.0  # [s] time in the gallery since the last match


class StrongSort3dConfig(Config, frozen=True, kw_only=True):
    """StrongSORT-3D [PIC4SeR], section 5, and the policies around it."""

    # round 1
    # C_cos, maximum cosine distance by name of the embedder (section 5); defaults:
    # COSINE_DISTANCE_MAX, else COSINE_DISTANCE_MAX_OTHER
    cosine_distance_max: dict[str, CosineDistance] = msgspec.field(default_factory=dict)
    # round 2
    distance_max_m: Positive = 0.7  # [m] maximum 3D distance; section 5 (default)
    # life cycle
    n_init: PositiveInt = 2  # matches that confirm, including the first; section 5 (default): 3
    a_max: PositiveInt = 30  # [frames] unmatched frames that delete a track; section 5 (default)
    # "streak": consecutive matches confirm, and one miss ends a tentative track; section 5. "hits":
    # any matches confirm, and as many misses as matches, at most a_max, end a track
    lifetime: Literal["streak", "hits"] = "hits"
    # noise: accelerations of people exceed the 0.5 m/s^2 of section 3 (benchmarks/ablation.md)
    sigma_acceleration_mps2: Positive = 3.0  # [m/s^2] of people; section 3: 0.5
    # [m] standard deviation of detections without a covariance; section 3: 0.5
    sigma_measurement_m: Positive = 0.15
    # "measured": R is the covariance of the detection if there is one, independent of depth and
    # score; "constant": sigma_measurement_m; section 3
    noise: Literal["constant", "measured"] = "measured"
    # policies beyond section 5, with a switch for each
    visibility: bool = True  # keep occluded tracks, end tracks at empty positions; section 13
    identity: IdentityConfig = IdentityConfig()  # re-identify returning people; section 15
    standing_model: bool = True  # estimate standing and walking people by two models; section 16

    def cosine_limit(self, embedder: str) -> float:
        """Return C_cos of an embedder."""
        shipped = COSINE_DISTANCE_MAX.get(embedder, COSINE_DISTANCE_MAX_OTHER)
        return self.cosine_distance_max.get(embedder, shipped)
