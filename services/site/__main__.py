"""Run the site: python -m services.site."""

import sys

from common.runtime import process
from services.site.build import build
from services.site.config import SiteConfig

if __name__ == "__main__":
    sys.exit(process.main("site", SiteConfig, build))
