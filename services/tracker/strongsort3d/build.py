"""Composition of StrongSORT-3D and its policies from the configuration."""

from functools import partial

from services.tracker.config import TrackerConfig
from services.tracker.identity.reidentification import Reidentification
from services.tracker.motion.motion import PositionMotion
from services.tracker.motion.state_filter import (
    Imm,
    KalmanFilter,
    StateFilter,
    decay_velocity,
    no_decay,
)
from services.tracker.motion.track_set import LifecyclePolicy, TrackSet
from services.tracker.motion.yaw_sources import make_yaw
from services.tracker.strongsort3d.base_drift import BaseDrift
from services.tracker.strongsort3d.config import StrongSort3dConfig
from services.tracker.strongsort3d.contact import Contact
from services.tracker.strongsort3d.occlusion import FieldOfView, Occlusion
from services.tracker.strongsort3d.policies import (
    ContactPolicy,
    IdentityPolicy,
    Policies,
    TrackPolicy,
)
from services.tracker.strongsort3d.strongsort3d import StrongSort3d


def build_strongsort3d(config: TrackerConfig) -> StrongSort3d:
    """Build the tracker with the policies that the configuration enables."""
    strong = config.strongsort3d
    motion = PositionMotion(strong)
    lifecycle = LifecyclePolicy(
        # An identity is decided before the track is published, at the second match at the earliest.
        confirm_hits=max(strong.n_init, 2 if strong.identity.enabled else 1),
        tentative_frames=1,
        lost_frames=strong.a_max,
        lost_s=config.max_lost_s,
        by_hits=strong.lifetime == "hits",
    )
    tracks = TrackSet(motion, lifecycle, make_yaw(config), _state_filter(strong, motion))
    occlusion: tuple[TrackPolicy, ...] = ()
    if strong.occlusion.enabled:
        occlusion = (FieldOfView(strong.occlusion), Occlusion(strong.occlusion))
    policies = Policies(
        contact=Contact(strong.contact) if strong.contact.enabled else ContactPolicy(),
        identity=Reidentification(strong.identity) if strong.identity.enabled else IdentityPolicy(),
        tracks=(BaseDrift(config.base), *occlusion),
    )
    return StrongSort3d(strong, motion, tracks, policies)


def _state_filter(config: StrongSort3dConfig, motion: PositionMotion) -> StateFilter:
    enabled = config.occlusion.enabled
    decay = partial(decay_velocity, config=config.occlusion) if enabled else no_decay
    if config.imm.enabled:
        return Imm(motion, config.imm, decay, config.jump_min)
    return KalmanFilter(motion, decay, config.jump_min)
