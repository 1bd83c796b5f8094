"""Configuration of the router."""

import msgspec


class RouterConfig(msgspec.Struct, frozen=True, kw_only=True):
    """Empty configuration: endpoints and access are in the Zenoh configuration."""
