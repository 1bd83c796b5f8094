"""Fixtures of live topics."""

import itertools
import os
from collections.abc import Iterator

import pytest
import zenoh

from tests.camera.ros.live_topics import Raw
from tests.network import Network

_namespaces = itertools.count(1)


@pytest.fixture
def namespace() -> str:
    """Namespace of a camera that no other test has."""
    return f"/n{os.getpid()}_{next(_namespaces)}"


@pytest.fixture
def raw(network: Network, namespace: str) -> Iterator[Raw]:
    """Publisher of bytes on the router of the tests."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{network.endpoint}"]')
    with zenoh.open(config) as session:
        yield Raw(session, namespace)
