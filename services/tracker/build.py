"""Build trackers by name, and the node of the service."""

from common import registry
from services.tracker.config import TrackerConfig
from services.tracker.interface import Tracker
from services.tracker.node import TrackerNode

TRACKERS: dict[str, str] = {
    "sort3d": "services.tracker.sort3d.sort3d:Sort3d",
    "strongsort3d": "services.tracker.strongsort3d.build:build_strongsort3d",
    "image_sort": "services.tracker.image_sort.image_tracker:ImageTracker",
}


def make_tracker(config: TrackerConfig) -> Tracker:
    """Build the configured tracker, importing its module on demand.

    Args:
        config: `tracker` is a name of TRACKERS or module:Class; the class is called with `config`.

    Raises:
        ConfigError: The name is unknown, or the module or class cannot be found.
    """
    tracker: Tracker = registry.find("tracker", TRACKERS, config.tracker)(config)
    if config.area.number and tracker.ids:
        tracker.ids.divide(config.area.number)
    return tracker


def build(config: TrackerConfig) -> TrackerNode:
    """Build the node with the tracker that the configuration names."""
    return TrackerNode(config, make_tracker(config))
