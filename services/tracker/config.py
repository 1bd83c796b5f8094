"""Configuration of the tracker service; every constant of the methods is here."""

from typing import Any, Literal

import msgspec

from common.geometry.transform_history import TransformBufferConfig
from services.tracker.identity.config import ContactConfig, IdentityConfig, OcclusionConfig
from services.tracker.image_sort.config import ImageSortConfig
from services.tracker.motion.standing_config import StandingConfig

CHI2_3DOF_95 = 7.8147

# Measured: benchmarks/reid_threshold.md.
COSINE_DISTANCE_MAX = {"histogram": 0.25, "osnet": 0.45}


def _expect(holds: bool, field: str, expected: str, got: object) -> None:
    if not holds:
        raise ValueError(f"{field}: expected {expected}, got {got}")


def _expect_positive(record: msgspec.Struct, *fields: str) -> None:
    for field in fields:
        value = getattr(record, field)
        _expect(0 < value < float("inf"), field, "a finite number > 0", value)


def _expect_ratio(record: msgspec.Struct, *fields: str) -> None:
    for field in fields:
        value = getattr(record, field)
        _expect(0 <= value <= 1, field, "0 to 1", value)


class Sort3dConfig(msgspec.Struct, frozen=True, kw_only=True):
    """SORT-3D (method book section 4). Where no source is named the value is this project's."""

    # association
    iou_weight: float = 0.3  # a in c = a (1 - IoU) + (1 - a) d_n; section 4
    iou_gate: bool = True  # refuse pairs with IoU < iou_min; section 4
    iou_min: float = 0.3  # section 4 (default)
    distance_gate: bool = True  # refuse pairs with d >= tau; section 4
    distance_gate_sigmas: float = 1.6  # tau = mu + 1.6 sigma of the previous frame; section 4
    # [m] tau is not taken below this. With one person sigma is 0 and tau the last distance itself,
    # so that the plain rule refuses about every second match. 0 gives the plain rule.
    distance_gate_floor_m: float = 0.5
    # life cycle
    min_hits: int = 3  # matches in a row, the first included, that confirm; section 4 (default)
    t_lost: int = 30  # [frames] unmatched frames that delete; plain SORT has 1 (section 7)
    # noise of the person
    sigma_acceleration_mps2: float = 2.0  # [m/s^2] a walking person turning
    sigma_measurement_m: float = 0.15  # [m]
    # "measured": R is the covariance of the detection where the detector tells one, and neither
    # depth nor score change it; "constant": sigma_measurement_m; the paper's, section 3
    noise: Literal["constant", "measured"] = "constant"
    # R is so many times that covariance: errors of consecutive frames are much alike, and count as
    # if they were independent otherwise; this project's
    noise_factor: float = 2.0
    sigma_start_velocity_mps: float = 2.0  # [m/s] of a new track: "large", section 4
    # noise of the box
    sigma_centre_px: float = 5.0  # [px] measured centre
    sigma_acceleration_pxps2: float = 500.0  # [px/s^2] of the centre
    sigma_start_centre_pxps: float = 300.0  # [px/s] of a new track
    sigma_area_ratio: float = 0.1  # measured area, as a part of the area
    sigma_acceleration_area_ratio: float = 2.0  # [1/s^2] of the area, as a part of the area
    sigma_start_area_ratio_hz: float = 1.0  # [1/s] of the area of a new track, as a part of it
    sigma_aspect: float = 0.1  # measured width over height
    sigma_aspect_drift: float = 0.2  # [1/sqrt(s)] of width over height

    def __post_init__(self) -> None:
        """Check ranges."""
        _expect_ratio(self, "iou_weight", "iou_min")
        for field in self.__struct_fields__:
            if field.startswith("sigma"):
                _expect_positive(self, field)
        _expect_positive(self, "distance_gate_sigmas", "min_hits", "t_lost", "noise_factor")
        _expect(
            self.distance_gate_floor_m >= 0,
            "distance_gate_floor_m",
            "a number >= 0",
            self.distance_gate_floor_m,
        )


class StrongSort3dConfig(msgspec.Struct, frozen=True, kw_only=True):
    """StrongSORT-3D (section 5). Where no source is named the value is this project's."""

    # round 1
    motion_weight: float = 0.02  # lambda in c = lambda d_M^2 + (1 - lambda) d_cos; section 5
    mahalanobis_max: float = CHI2_3DOF_95  # largest d_M^2: chi^2, 3 dof, 95 %; section 5
    # C_cos, largest cosine distance, by the name of the embedder (section 5: per embedder). What is
    # not named here is taken from COSINE_DISTANCE_MAX, else it is cosine_distance_max_other.
    cosine_distance_max: dict[str, float] = msgspec.field(default_factory=dict)
    cosine_distance_max_other: float = 0.3
    ema_alpha: float = 0.9  # e <- alpha e + (1 - alpha) f; section 5 (default)
    # round 2
    distance_max_m: float = 0.7  # [m] largest 3D distance; section 5 (default)
    # life cycle
    n_init: int = 3  # consecutive matches, the first included, that confirm; section 5 (default)
    a_max: int = 30  # [frames] unmatched frames that delete; section 5 (default)
    # noise
    sigma_acceleration_mps2: float = 0.5  # [m/s^2] section 3
    sigma_measurement_m: float = 0.5  # [m] section 3
    sigma_start_velocity_mps: float = 2.0  # [m/s] of a new track
    max_depth_m: float = 5.0  # [m] in R <- (1 + x / max_depth) R; section 3, eq. 4.11
    nsa_floor: float = 0.05  # smallest factor 1 - score; 1.0 switches NSA off; section 3, eq. 3.4
    # "measured": R is the covariance of the detection where the detector tells one, and neither
    # depth nor score change it; "constant": sigma_measurement_m; the paper's, section 3
    noise: Literal["constant", "measured"] = "constant"
    # R is so many times that covariance: errors of consecutive frames are much alike, and count as
    # if they were independent otherwise; this project's
    noise_factor: float = 2.0
    # beyond the paper, each with its own switch
    occlusion: OcclusionConfig = OcclusionConfig()  # whoever is hidden keeps their track
    contact: ContactConfig = ContactConfig()  # whoever touches somebody keeps their own track
    identity: IdentityConfig = IdentityConfig()  # whoever comes back gets their identity back
    standing: StandingConfig = StandingConfig()  # whoever stands has no velocity

    def __post_init__(self) -> None:
        """Check ranges."""
        _expect_ratio(self, "motion_weight", "ema_alpha")
        _expect_positive(
            self,
            *("mahalanobis_max", "distance_max_m", "n_init", "a_max", "max_depth_m"),
            *("sigma_acceleration_mps2", "sigma_measurement_m", "sigma_start_velocity_mps"),
            "noise_factor",
        )
        _expect(0 < self.nsa_floor <= 1, "nsa_floor", "above 0, at most 1", self.nsa_floor)
        limits = {**self.cosine_distance_max, "other embedders": self.cosine_distance_max_other}
        for name, limit in limits.items():
            _expect(0 < limit <= 2, f"cosine_distance_max of {name}", "above 0, at most 2", limit)

    def cosine_limit(self, embedder: str) -> float:
        """Return C_cos of an embedder."""
        shipped = COSINE_DISTANCE_MAX.get(embedder, self.cosine_distance_max_other)
        return self.cosine_distance_max.get(embedder, shipped)


class YawFilterConfig(msgspec.Struct, frozen=True, kw_only=True):
    """The filter of the yaw from keypoints (section 6); its values are this project's."""

    sigma_acceleration_radps2: float = 6.0  # [rad/s^2] a walking person turning
    sigma_measurement_rad: float = 0.35  # [rad] of every measurement
    # True: each measurement counts by its own standard deviation, where the detector told one.
    measured_sigma: bool = False
    sigma_start_rate_radps: float = 1.0  # [rad/s] of a person seen for the first time
    # [rad] of the way a person walks as a second measurement; inf: it is none, section 6
    sigma_walk_rad: float = float("inf")
    walk_speed_min_mps: float = 0.5  # [m/s] slower people do not walk
    # A measurement farther off counts only as if it were so many standard deviations off: one that
    # is turned round, or of a neighbour, bends the yaw a little instead of taking it over. inf: all
    # measurements count alike, section 6
    outlier_sigmas: float = float("inf")
    # [s] time constant with which an unmeasured turn dies out; inf: constant velocity, section 6
    rate_decay_s: float = float("inf")

    def __post_init__(self) -> None:
        """Check ranges."""
        _expect_positive(self, "sigma_acceleration_radps2", "sigma_measurement_rad")
        _expect_positive(self, "sigma_start_rate_radps")
        for field in ("sigma_walk_rad", "walk_speed_min_mps", "outlier_sigmas", "rate_decay_s"):
            _expect(getattr(self, field) > 0, field, "a number > 0", getattr(self, field))


class TrackerConfig(msgspec.Struct, frozen=True, kw_only=True):
    """Configuration of the tracker service."""

    # sort3d, strongsort3d, image_sort, or module:Class of your own
    tracker: str = "strongsort3d"
    # Frame that tracks are in: one that stands, or the robot's own ("base_link") where there is no
    # map; velocities are over the ground then, too
    frame_id: str = "map"
    # True: a frame without a transform from its camera is dropped. False: the camera is taken to
    # stand at the origin and look along +x, which the status tells.
    require_transform: bool = False
    # output
    publish_lost: bool = True  # publish people not seen in this frame, predicted; section 4: False
    publish_tentative: bool = False  # publish people not yet confirmed
    # Which way a person faces. "keypoints": as the detector measured it, filtered (section 6);
    # "velocity": the way they walk (section 4, eq. 4.9); "none": not told.
    yaw: Literal["keypoints", "velocity", "none"] = "velocity"
    yaw_speed_min_mps: float = 0.2  # [m/s] slower people have no yaw from velocity; section 4: 0
    yaw_filter: YawFilterConfig = YawFilterConfig()  # of "keypoints"
    # time
    max_lost_s: float = 5.0  # [s] without a match after which any track is deleted
    # Where no frame came for longer than max_lost_s, or the tracker did not run, nobody was missed:
    # whoever is found where they would be after absence_moved_s keeps their identity
    absence_max_s: float = 30.0  # [s] longest such time; max_lost_s or less: never
    absence_moved_s: float = 1.0  # [s]
    clock_jump_s: float = 1.0  # [s] a stamp this far back begins a new time; nearer, it is stale
    embedding_wait_s: float = 0.05  # [s] longest wait for the embeddings of a frame
    embedding_patience: int = 3  # frames waited for in vain after which waiting stops
    # [s] with several cameras or detectors, longest wait for frames that belong before the one that
    # is there; absent: as long as from one frame of the camera to the next
    reorder_wait_s: float | None = None
    odometry_wait_s: float = 0.05  # [s] longest wait for the odometry of a frame, if the base moves
    predict_after_s: float = 0.2  # [s] without detections after which predictions are published
    predict_hz: float = 10.0  # [Hz] rate of those predictions
    # input
    base: TransformBufferConfig = TransformBufferConfig()  # plausible motion of the base
    max_range_m: float = 100.0  # [m] positions farther from the camera are not believed
    # methods
    sort3d: Sort3dConfig = Sort3dConfig()
    strongsort3d: StrongSort3dConfig = StrongSort3dConfig()
    # Places of people are filtered with the constants of strongsort3d
    image_sort: ImageSortConfig = ImageSortConfig()
    options: dict[str, Any] = msgspec.field(default_factory=dict)  # for a tracker of your own

    def __post_init__(self) -> None:
        """Check ranges."""
        _expect_positive(self, "max_lost_s", "clock_jump_s", "predict_after_s", "predict_hz")
        _expect_positive(self, "embedding_patience", "max_range_m", "absence_max_s")
        _expect_positive(self, "absence_moved_s")
        for field in ("embedding_wait_s", "odometry_wait_s", "reorder_wait_s", "yaw_speed_min_mps"):
            value = getattr(self, field) or 0.0
            _expect(0 <= value < float("inf"), field, "a finite number >= 0", value)
