"""Configuration and the choice of the tracker."""

import sys
from pathlib import Path

import pytest

from common.config import load
from people4d.errors import ConfigError
from services.tracker.build import TRACKERS, make_tracker
from services.tracker.config import TrackerConfig


def config(*overrides: str) -> TrackerConfig:
    return load(TrackerConfig, "tracker", overrides=overrides, environment={})


def test_defaults_are_what_ships() -> None:
    defaults = config()
    strong = defaults.strongsort3d
    assert (defaults.tracker, defaults.yaw, strong.noise) == (
        "strongsort3d",
        "keypoints",
        "measured",
    )
    assert strong.visibility
    assert strong.identity.enabled
    assert strong.standing_model


def test_nested_fields_are_set_by_name() -> None:
    changed = config("strongsort3d.n_init=2", "strongsort3d.cosine_distance_max.osnet=0.4")
    assert changed.strongsort3d.n_init == 2
    assert changed.strongsort3d.a_max == 30
    limits = [changed.strongsort3d.cosine_limit(name) for name in ("osnet", "histogram", "own")]
    assert limits == [0.4, 0.25, 0.3]


@pytest.mark.parametrize(
    ("override", "problem"),
    [
        ("strongsort3d.n_int=2", "no field 'n_int'. Did you mean n_init?"),
        ("strongsort3d.distance_max_m=0", "distance_max_m: expected .* > 0"),
        ("strongsort3d.cosine_distance_max.osnet=3", "cosine_distance_max.*: expected .* <= 2"),
        ("sort3d.t_lost=0", "t_lost: expected .* >= 1"),
        ("strongsort3d.sigma_measurement_m=nan", "sigma_measurement_m: expected"),
        ("max_lost_s=0", "max_lost_s: expected .* > 0"),
        ("embedding_wait_s=-1", "embedding_wait_s: expected .* >= 0"),
    ],
)
def test_bad_values_are_refused(override: str, problem: str) -> None:
    with pytest.raises(ConfigError, match=problem):
        config(override)


@pytest.mark.parametrize("name", TRACKERS)
def test_every_tracker_can_be_made(name: str) -> None:
    tracker = make_tracker(config(f"tracker={name}"))
    assert tracker.uses_embeddings is (name == "strongsort3d")


def test_unknown_trackers_are_refused() -> None:
    with pytest.raises(ConfigError, match="Choose sort3d, strongsort3d, image_sort, or"):
        make_tracker(config("tracker=deepsort"))
    with pytest.raises(ConfigError, match="cannot be loaded: No module named 'nowhere'"):
        make_tracker(config("tracker=nowhere:Tracker"))
    with pytest.raises(ConfigError, match="cannot be loaded"):
        make_tracker(config("tracker=services.tracker.sort3d.sort3d:Missing"))


def test_a_tracker_of_your_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "own_tracker.py").write_text(
        "class Empty:\n    def __init__(self, config):\n        self.options = config.options\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    tracker = make_tracker(config("tracker=own_tracker:Empty", "options.speed=3"))
    assert vars(tracker) == {"options": {"speed": 3}}
    del sys.modules["own_tracker"]
