"""Constants of the published segmentation and mesh."""

import pytest

from services.gait.surface import mesh, segmentation

SEGMENTATION = {
    "FILL_PASSES": 1,
    "FILL_NEIGHBOURS": 1,
    "DEPTH_STEPS": (0.010, 0.0, 0.0),
    "JOIN_M": 0.0,
    "PIXELS_MIN": 1,
}
MESH = {
    "DEPTH_STEPS": (0.010, 0.0, 0.0),
    "JOIN_M": 0.0,
    "VERTICES": 10**9,
    "EDGE_STRETCH": 0.0,
    "EDGE_NOISE_PER_M2": 0.0,
    "SMOOTH_PX": 0,
}


@pytest.fixture
def published(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fixed thresholds, each pixel a vertex, nothing smoothed or joined."""
    for module, constants in ((segmentation, SEGMENTATION), (mesh, MESH)):
        for name, value in constants.items():
            monkeypatch.setattr(module, name, value)
