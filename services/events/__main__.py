"""Run the events: python -m services.events."""

import sys

from common.runtime import process
from services.events.build import build
from services.events.config import EventsConfig

if __name__ == "__main__":
    sys.exit(process.main("events", EventsConfig, build))
