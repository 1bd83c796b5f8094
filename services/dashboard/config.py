"""Configuration of the dashboard."""

from typing import Annotated

from msgspec import Meta

from common.config import Config
from people4d.messages.base import Name, Positive


class DashboardConfig(Config, frozen=True, kw_only=True):
    """Address, access and load."""

    host: str = "127.0.0.1"  # address of the page; other machines need a token
    port: Annotated[int, Meta(ge=0, le=65535)] = 7480  # port of the page; 0: any free port
    # further names of this machine in browsers, in addition to `host`, localhost and its host name
    allowed_hosts: tuple[str, ...] = ()
    # tokens of the roles, see docs/operation/dashboard.md; empty: generated, in the state folder
    operator_token: str = ""
    planner_token: str = ""  # see operator_token
    certificate: str = ""  # PEM file of the certificate; with its key the page is served by https
    certificate_key: str = ""  # PEM file of the certificate's key
    # True: programs may read people as JSON, see docs/operation/json.md
    people_json: bool = False
    privacy: bool = False  # True: no images or depth leave the process
    rate_max_hz: Positive = 10.0  # maximum rate of images and people [Hz]
    history_s: Positive = 60.0  # length of the history that viewers can go back to [s]
    base_frame: Name = "base_link"  # frame of the robot's base
