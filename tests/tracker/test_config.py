"""Configuration and the choice of the tracker."""

import sys
from pathlib import Path

import pytest

from common.config import load
from people4d.errors import ConfigError
from services.tracker.config import TrackerConfig
from services.tracker.interface import Need
from services.tracker.registry import TRACKERS, make_tracker


def config(*overrides: str) -> TrackerConfig:
    return load(TrackerConfig, "tracker", overrides=overrides, environment={})


def test_constants_of_the_method_book() -> None:
    defaults = config()
    sort, strong = defaults.sort3d, defaults.strongsort3d
    assert (sort.iou_weight, sort.iou_min) == (0.3, 0.3)
    assert (sort.distance_gate_sigmas, sort.min_hits) == (1.6, 3)
    assert (strong.motion_weight, strong.mahalanobis_max, strong.ema_alpha) == (0.02, 7.8147, 0.9)
    assert (strong.n_init, strong.a_max, strong.max_depth_m) == (3, 30, 5.0)
    assert (strong.sigma_acceleration_mps2, strong.sigma_measurement_m) == (0.5, 0.5)


def test_nested_fields_are_set_by_name() -> None:
    changed = config("strongsort3d.n_init=2", "strongsort3d.cosine_distance_max.osnet=0.4")
    assert changed.strongsort3d.n_init == 2
    assert changed.strongsort3d.a_max == 30
    limits = [changed.strongsort3d.cosine_limit(name) for name in ("osnet", "histogram", "own")]
    assert limits == [0.4, 0.25, 0.3]


@pytest.mark.parametrize(
    ("override", "told"),
    [
        ("strongsort3d.n_int=2", "no field 'n_int'. Did you mean n_init?"),
        ("strongsort3d.nsa_floor=0", "nsa_floor: expected above 0, at most 1, got 0"),
        ("strongsort3d.max_depth_m=-1", "max_depth_m: expected a finite number > 0"),
        ("strongsort3d.cosine_distance_max.osnet=3", "cosine_distance_max of osnet: expected"),
        ("sort3d.iou_min=1.5", "iou_min: expected 0 to 1, got 1.5"),
        ("sort3d.t_lost=0", "t_lost: expected a finite number > 0, got 0"),
        ("sort3d.sigma_centre_px=nan", "sigma_centre_px: expected a finite number > 0"),
        ("predict_hz=0", "predict_hz: expected a finite number > 0"),
        ("embedding_wait_s=-1", "embedding_wait_s: expected a finite number >= 0"),
    ],
)
def test_bad_values_are_told(override: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        config(override)


@pytest.mark.parametrize("name", TRACKERS)
def test_every_tracker_can_be_made(name: str) -> None:
    tracker = make_tracker(config(f"tracker={name}"))
    assert (Need.EMBEDDINGS in tracker.needs) is (name == "strongsort3d")


def test_unknown_trackers_are_told() -> None:
    with pytest.raises(ConfigError, match="Choose sort3d, strongsort3d, image_sort, or"):
        make_tracker(config("tracker=deepsort"))
    with pytest.raises(ConfigError, match="cannot be loaded: No module named 'nowhere'"):
        make_tracker(config("tracker=nowhere:Tracker"))
    with pytest.raises(ConfigError, match="cannot be loaded"):
        make_tracker(config("tracker=services.tracker.sort3d.sort3d:Missing"))


def test_a_tracker_of_your_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "own_tracker.py").write_text(
        "from services.tracker.interface import Need\n"
        "class Nobody:\n"
        "    needs = frozenset()\n"
        "    def __init__(self, config):\n"
        "        self.options = config.options\n"
        "class Driver(Nobody):\n"
        "    needs = frozenset({Need.ODOMETRY})\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    tracker = make_tracker(config("tracker=own_tracker:Nobody", "options.speed=3"))
    assert vars(tracker) == {"options": {"speed": 3}}
    with pytest.raises(ConfigError, match="needs odometry, which the service does not deliver"):
        make_tracker(config("tracker=own_tracker:Driver"))
    del sys.modules["own_tracker"]
