"""Two simulated people walking past each other, measured with noise."""

from pathlib import Path

import numpy as np
import pytest

from common.geometry.transforms import apply, invert
from people4d.messages import F64
from services.tracker.build import make_tracker
from services.tracker.interface import Measurement, Observation
from tests.tracker.scene import published_config, unit
from tests.two_people import truth_of

pytestmark = pytest.mark.slow

VISIBLE_MIN = 0.3


def rmse(errors: list[F64]) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


# The noise suits a stereo camera at 3 to 5 m. StrongSORT-3D is run with [PIC4SeR]'s noise model
# (sigma_a = sigma_m = 0.5), which lags behind turns: it pays from about 0.12 m of noise on.
@pytest.mark.parametrize(("name", "noise_m"), [("sort3d", 0.05), ("strongsort3d", 0.2)])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_two_identities_and_less_error_than_measured(
    shared: Path, name: str, noise_m: float, seed: int
) -> None:
    names = ("t", "T_world_cam", "pos", "vis", "bbox")
    truth = {name: truth_of(shared, name) for name in names}
    rng = np.random.default_rng(seed)
    tracker = make_tracker(published_config(tracker=name))
    identities: set[tuple[int, int | None]] = set()
    measured, tracked = list[F64](), list[F64]()
    for k, t_s in enumerate(truth["t"]):
        camera_from_map = invert(truth["T_world_cam"][k])
        detected = []
        for p in range(2):
            position = truth["pos"][k, p] + rng.normal(0, noise_m, 3)
            if truth["vis"][k, p] < VISIBLE_MIN:
                continue
            detected.append(
                Measurement(
                    index=p,
                    box_xyxy_px=truth["bbox"][k, p] + rng.normal(0, 3, 4),
                    score=0.9,
                    position_m=position,
                    forward_m=float(apply(camera_from_map, position)[2]),
                    embedding=unit(np.eye(4)[p] + rng.normal(0, 0.2, 4)),
                )
            )
            measured.append(position - truth["pos"][k, p])
        observation = Observation(int(t_s * 1e9), tuple(detected), embedder="histogram")
        for track in tracker.update(observation):
            if track.state == "confirmed" and track.detection is not None:
                identities.add((track.id, track.detection))
                tracked.append(track.position_m - truth["pos"][k, track.detection])
    assert len(identities) == 2
    assert len(tracked) > 0.9 * len(measured)
    assert rmse(tracked) < rmse(measured)
