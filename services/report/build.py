"""Build the node of the service from its configuration."""

from common.runtime.node import Node
from services.report.config import ReportConfig
from services.report.folder import ReportFolder
from services.report.node import ReportNode


def build(config: ReportConfig) -> Node:
    """Make the folder and the node."""
    return ReportNode(config, ReportFolder(config))
