"""Hooks of the services' nodes."""

from pathlib import Path

import pytest

from common.runtime.node import Node, StatefulNode
from deploy.launcher.watchdog import WatchdogNode
from tests.services import SERVICES, node_of


@pytest.mark.parametrize("service", [*SERVICES, "watchdog"])
def test_node_has_no_public_name_that_its_base_class_lacks(service: str, tmp_path: Path) -> None:
    # A misspelt hook would never be called, without an error.
    kind: type[Node] = WatchdogNode
    if service != "watchdog":
        node = node_of(service, tmp_path)
        node.close()
        kind = type(node)
    own = {name for name in vars(kind) if not name.startswith("_")}
    assert own <= set(dir(StatefulNode))
