"""Whether what the particles of a point tell is believed."""

import numpy as np

from common.geometry.transforms import project
from people4d.messages import F64, CameraInfo
from services.gait.points.config import DepthLayerConfig
from services.gait.points.limbs import Body3d
from services.gait.points.point_filter import PointFilter
from services.gait.points.points import SURE
from services.gait.points.weighing import Hints, Weighed, agreement

APART = 3.0  # [standard deviations] of a point and its keypoint, which then disagree
ROUND = 1.5  # [standard deviations] that count as one where agreement is judged


class Judge:
    """Takes in what particles tell of a point, if enough speaks for it.

    Args:
        config: How much is enough.
        info: Calibration.
    """

    def __init__(self, config: DepthLayerConfig, info: CameraInfo) -> None:
        self._config, self._info = config, info

    def take(
        self, point: PointFilter, body: Body3d, weighed: Weighed, hints: Hints, dt_s: float
    ) -> None:
        """Take in the weighed particles, and draw them anew.

        Args:
            point: With particles on the body.
            body: Its surface.
            weighed: Their weights.
            hints: What else speaks for the point.
            dt_s: Since the last frame.
        """
        logs = weighed.logs
        best = int(np.argmax(logs))
        if not np.isfinite(logs[best]):
            point.missed(dt_s)
            point.scatter(body)
            return
        weights = np.exp(logs - logs[best])
        weights /= weights.sum()
        places = body.surface.points_m[np.maximum(point.vertices, 0)]
        if self._config.feature == "combined":
            near = np.linalg.norm(places - places[best], axis=1) <= self._config.window_m
            kept = weights * near * (point.vertices >= 0)
            position = (kept / kept.sum()) @ places
            self._judge(point, body, position, int(point.vertices[best]), hints, dt_s)
        else:
            point.measured(places[best], 1.0)
        point.resample(weights)

    def _judge(
        self,
        point: PointFilter,
        body: Body3d,
        position: F64,
        vertex: int,
        hints: Hints,
        dt_s: float,
    ) -> None:
        assert point.motion is not None
        config = self._config
        noise = point.noise_m2(position)
        off = float(np.sqrt(point.motion.distances2(position[None], noise)[0]))
        support = max(
            self._by_limb(point, body, vertex, hints), self._by_anchor(point, position, hints)
        )
        point.unsupported_s = 0.0 if support > config.confidence_min else point.unsupported_s + dt_s
        # Neither limb nor keypoint: what is alike elsewhere is believed for a while only.
        waned = float(np.exp(-point.unsupported_s / (2 * config.patience_s))) if point.kind else 1.0
        support = max(support, waned * self._by_distance(point, body, vertex))
        confidence = support * _agreed(off / config.gate * ROUND**2)
        if off > config.gate or confidence < config.confidence_min or point.state == "lost":
            point.missed(dt_s)
            return
        point.measured(position, confidence)
        if confidence > SURE:
            point.adapt(float(body.along_m[vertex]))

    def _by_limb(self, point: PointFilter, body: Body3d, vertex: int, hints: Hints) -> float:
        """Return how well a vertex fits the end of the point's limb, 0 to 1."""
        end = hints.end
        if end is None or body.tips.basin[vertex] != end.basin or not np.isfinite(point.below_m):
            return 0.0
        off = float(body.below_m[vertex] - point.below_m) / self._config.tip_sigma_m
        return end.strength * _agreed(off)

    def _by_distance(self, point: PointFilter, body: Body3d, vertex: int) -> float:
        """Return how well a vertex fits the point's distance along the body, 0 to 1."""
        off = float(body.along_m[vertex] - point.along_m) / self._config.geodesic_sigma_m
        return _agreed(off) if np.isfinite(off) else 0.0

    def _by_anchor(self, point: PointFilter, position: F64, hints: Hints) -> float:
        """Return how well a position fits the point's keypoint, 0 to 1."""
        anchor = hints.anchor
        if anchor is None:
            return 0.0
        pixel = project(position, self._info)[0]
        apart = float(np.linalg.norm(pixel - anchor.pixel)) / hints.anchor_sigma_px
        contradicts = apart > APART and anchor.confidence > SURE
        point.contradicted = point.contradicted + 1 if contradicts else 0
        return float(np.clip((anchor.confidence - 0.4) / 0.3, 0.0, 1.0)) * _agreed(apart)


def _agreed(off: float) -> float:
    return float(agreement(np.array(off / ROUND)))
