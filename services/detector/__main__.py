"""The detector as a process: python -m services.detector."""

import sys

from common import process
from common.node import Node
from services.detector.config import DetectorConfig
from services.detector.models import PersonModel, load_model
from services.detector.node import DetectorNode


def build(config: DetectorConfig, model: PersonModel | None = None) -> Node:
    """Make the detector; its model is loaded here, so that a missing one is told at start.

    Args:
        config: Its configuration.
        model: What finds people; None: the configured model.
    """
    return DetectorNode(model or load_model(config), config)


def main() -> int:
    """Run the detector; two threads, so that one prepares a frame while the other infers."""
    return process.main("detector", DetectorConfig, build, workers=2)


if __name__ == "__main__":
    sys.exit(main())
