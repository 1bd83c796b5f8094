"""Build the node of the service from its configuration."""

import numpy as np

from people4d.messages import Track, Tracks
from services.predictor.config import PredictorConfig
from services.predictor.node import PredictorNode

PERIOD_NS = 200_000_000


def warm_up(config: PredictorConfig) -> None:
    """Compile all functions by predictions of one person for a second."""
    node = PredictorNode(config)
    for number in range(6):
        person = Track(
            id=1,
            state="confirmed",
            position_m=np.array([0.2 * number, 0.0, 1.0]),
            velocity_mps=np.array([1.0, 0.0, 0.0]),
            covariance=np.eye(6) * 0.01,
            yaw_rad=0.0,
            hits=number + 1,
            age=number + 1,
            time_since_update_s=0.0,
            detection=0,
            score=1.0,
        )
        tracks = Tracks(
            stamp_ns=number * PERIOD_NS,
            sequence=number,
            frame_id="none",
            tracker="none",
            camera="none",
            tracks=(person,),
        )
        node.handle(tracks, number * PERIOD_NS)


def build(config: PredictorConfig) -> PredictorNode:
    """Build the node."""
    return PredictorNode(config)


def build_compiled(config: PredictorConfig) -> PredictorNode:
    """Build the node after compiling its functions."""
    warm_up(config)
    return build(config)
