"""The tracking methods by name."""

from common import registry
from people4d.errors import ConfigError
from services.tracker.config import TrackerConfig
from services.tracker.interface import Need, Tracker

TRACKERS: dict[str, str] = {
    "sort3d": "services.tracker.sort3d.sort3d:Sort3d",
    "strongsort3d": "services.tracker.strongsort3d.strongsort3d:StrongSort3d",
    "image_sort": "services.tracker.image_sort.image_tracker:ImageTracker",
}


def make_tracker(config: TrackerConfig) -> Tracker:
    """Build the configured tracker; its module is imported only now.

    Args:
        config: `tracker` is a name of TRACKERS or module:Class; the class is called with `config`.

    Raises:
        ConfigError: The name is unknown, the module or class cannot be found, or the tracker needs
            a stream that this service does not deliver.
    """
    tracker: Tracker = registry.find("tracker", TRACKERS, config.tracker)(config)
    if Need.ODOMETRY in tracker.needs:
        raise ConfigError(
            f"tracker {config.tracker!r} needs odometry, which the service does not deliver"
        )
    return tracker
