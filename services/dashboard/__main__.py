"""Run the dashboard: python -m services.dashboard."""

import os
import sys

from common.runtime import process
from services.dashboard.build import build
from services.dashboard.config import DashboardConfig

NICE = 10  # niceness of the process, below the pipeline's priority

if __name__ == "__main__":
    os.nice(NICE)
    sys.exit(process.main("dashboard", DashboardConfig, build))
