"""Run the report: python -m services.report --set folder=out; stop it with Ctrl-C."""

import sys
from pathlib import Path

from common import process
from common.node import Node
from services.report.config import ReportConfig
from services.report.folder import Folder
from services.report.node import ReportNode


def build(config: ReportConfig) -> Node:
    """Make the folder and the node."""
    return ReportNode(config, Folder(Path(config.folder)))


def main() -> int:
    """Run until stopped, then write the report."""
    return process.main("report", ReportConfig, build)


if __name__ == "__main__":
    sys.exit(main())
