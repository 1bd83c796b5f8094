"""Where a point may be, other than where its motion takes each particle."""

from common.geometry.transforms import project
from people4d.messages import CameraInfo
from services.gait.points.config import DepthLayerConfig
from services.gait.points.limbs import LimbEnd
from services.gait.points.point_filter import PointFilter, Proposal
from services.gait.points.points import Anchor

SPREAD_MAX_M = 0.15  # [m] of particles about the prediction, standard deviation
END_SIGMA_M = 0.03  # [m] of particles about the end of a limb


def pixels_of(length_m: float, depth_m: float, info: CameraInfo) -> float:
    """Return how many pixels a length takes at a depth."""
    return float(info.fx * length_m / max(depth_m, 0.1))


def sigma_px(anchor: Anchor, depth_m: float, info: CameraInfo, config: DepthLayerConfig) -> float:
    """Return the noise of where a keypoint puts a point, in pixels."""
    return anchor.sigma * pixels_of(config.keypoint_sigma_m, depth_m, info)


def proposals(
    point: PointFilter,
    anchor: Anchor | None,
    end: LimbEnd | None,
    info: CameraInfo,
    config: DepthLayerConfig,
) -> list[Proposal]:
    """Return where a point is predicted, and if known its keypoint and the end of its limb."""
    assert point.motion is not None
    here_m, share = point.motion.position_m, config.proposed / 2
    spread = pixels_of(min(point.motion.spread_m, SPREAD_MAX_M), here_m[2], info)
    found = [Proposal(project(here_m, info)[0], spread, share)]
    if anchor is not None:
        found.append(Proposal(anchor.pixel, sigma_px(anchor, here_m[2], info, config), share))
    if end is not None:
        sigma = pixels_of(END_SIGMA_M, end.position_m[2], info)
        found.append(Proposal(project(end.position_m, info)[0], sigma, share))
    return found
