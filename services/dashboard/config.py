"""Configuration of the dashboard."""

from typing import Annotated

from msgspec import Meta

from common.config import Config
from people4d.messages.base import Name, Positive, PositiveInt


class DashboardConfig(Config, frozen=True, kw_only=True):
    """Address, access, and load."""

    host: str = "127.0.0.1"  # address; beyond this machine a token is required
    port: Annotated[int, Meta(ge=0, le=65535)] = 7480  # 0: any free one
    # names by which browsers may reach it beside `host`, localhost and the machine's own name
    allowed_hosts: tuple[str, ...] = ()
    # tokens of the roles, see docs/operation/dashboard.md; empty: made once, in the state folder
    operator_token: str = ""
    planner_token: str = ""
    certificate: str = ""  # PEM file; with it and its key the page is served by https
    certificate_key: str = ""  # PEM file
    privacy: bool = False  # True: neither images nor depth leave the process
    viewers_max: Annotated[int, Meta(ge=1, le=1000)] = 32
    rate_max_hz: Positive = 10.0  # [Hz] images and people a second
    idle_hz: Positive = 2.0  # [Hz] people a second while no page is open
    cloud_hz: Positive = 4.0  # [Hz] depth clouds a second
    cloud_width_px: Annotated[int, Meta(ge=16, le=640)] = 128  # [px] columns of a cloud at most
    image_width_px: Annotated[int, Meta(ge=80, le=3840)] = 640  # [px] wider images are shrunk
    jpeg_quality: Annotated[int, Meta(ge=10, le=95)] = 75
    history_s: Positive = 60.0  # [s] that viewers can go back
    history_mb: PositiveInt = 64  # [MiB] of that at most
    stuck_s: Positive = 5.0  # [s] after which a viewer that reads nothing is dropped
    base_frame: Name = "base_link"  # the robot's base
