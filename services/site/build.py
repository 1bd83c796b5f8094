"""Build the node of the service from its configuration."""

from services.site.config import SiteConfig
from services.site.node import SiteNode


def build(config: SiteConfig) -> SiteNode:
    """Make the node."""
    return SiteNode(config)
