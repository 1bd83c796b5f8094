"""Check of the settings before the start."""

from pathlib import Path

from common.extras import need
from people4d.errors import ConfigError
from services.dashboard.config import DashboardConfig


def check_page(config: DashboardConfig) -> None:
    """Check that the web server is installed, and the files of the certificate.

    ConfigError if the server is not installed, or a file is unusable.
    """
    need("the dashboard", "dashboard")
    if bool(config.certificate) != bool(config.certificate_key):
        raise ConfigError("dashboard.certificate and dashboard.certificate_key belong together")
    for file in (config.certificate, config.certificate_key):
        if file and not Path(file).is_file():
            raise ConfigError(f"{file} of the dashboard does not exist", "Check the path.")
