"""Composition of StrongSORT-3D and its policies from the configuration."""

from services.tracker.config import TrackerConfig
from services.tracker.motion.lifecycle import HitsLifecycle, Lifecycle
from services.tracker.motion.motion import PositionMotion
from services.tracker.motion.state_filter import (
    Imm,
    KalmanFilter,
    StateFilter,
    decay_velocity,
    no_decay,
)
from services.tracker.motion.track_set import TrackSet
from services.tracker.motion.yaw_sources import make_yaw
from services.tracker.strongsort3d.base_drift import BaseDrift
from services.tracker.strongsort3d.config import StrongSort3dConfig
from services.tracker.strongsort3d.identity import Reidentification
from services.tracker.strongsort3d.policies import (
    IdentityPolicy,
    Policies,
    VisibilityPolicy,
)
from services.tracker.strongsort3d.strongsort3d import StrongSort3d
from services.tracker.strongsort3d.visibility import TrackVisibility


def build_strongsort3d(config: TrackerConfig) -> StrongSort3d:
    """Build the tracker with the policies that the configuration enables."""
    strong = config.strongsort3d
    motion = PositionMotion(strong)
    kind = HitsLifecycle if strong.lifetime == "hits" else Lifecycle
    lifecycle = kind(
        # The identity is decided before publication, from the second match on.
        confirm_hits=max(strong.n_init, 2 if strong.identity.enabled else 1),
        tentative_frames=1,
        lost_frames=strong.a_max,
        lost_s=config.max_lost_s,
    )
    yaw = make_yaw(config.yaw, config.yaw_speed_min_mps)
    tracks = TrackSet(
        motion,
        lifecycle,
        yaw,
        _state_filter(strong, motion),
    )
    policies = Policies(
        visibility=TrackVisibility() if strong.visibility else VisibilityPolicy(),
        identity=Reidentification(strong.identity) if strong.identity.enabled else IdentityPolicy(),
        drift=BaseDrift(),
    )
    return StrongSort3d(strong, motion, tracks, policies)


def _state_filter(config: StrongSort3dConfig, motion: PositionMotion) -> StateFilter:
    decay = decay_velocity if config.visibility else no_decay
    return Imm(motion, decay) if config.standing_model else KalmanFilter(motion, decay)
