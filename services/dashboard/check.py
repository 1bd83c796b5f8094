"""Check of the settings before the start."""

from pathlib import Path

from common.extras import need
from people4d.errors import ConfigError
from services.dashboard.config import DashboardConfig


def check_page(config: DashboardConfig) -> None:
    """Check that web server and certificate are there; ConfigError if one is unusable."""
    need("the dashboard", "dashboard")
    if bool(config.certificate) != bool(config.certificate_key):
        raise ConfigError("dashboard.certificate and dashboard.certificate_key belong together")
    for file in (config.certificate, config.certificate_key):
        if file and not Path(file).is_file():
            raise ConfigError(f"{file} of the dashboard does not exist", "Check the path.")
