"""Run the report: python -m services.report --set folder=out; stop it with Ctrl-C."""

import sys

from common.runtime import process
from services.report.build import build
from services.report.config import ReportConfig

if __name__ == "__main__":
    sys.exit(process.main("report", ReportConfig, build))
