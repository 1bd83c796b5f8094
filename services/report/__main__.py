"""Run the report: python -m services.report --set folder=out; stop it with Ctrl-C."""

import sys

from common.runtime import process
from services.report.build import build
from services.report.config import ReportConfig


def main() -> int:
    """Run until stopped, then write the report."""
    return process.main("report", ReportConfig, build)


if __name__ == "__main__":
    sys.exit(main())
