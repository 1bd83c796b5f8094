"""No valid message, however odd, makes a node raise or publish what cannot be decoded."""

import itertools
from pathlib import Path

import pytest

from people4d.codec import decode, encode
from people4d.messages import Message
from tests.contract.odd import in_order, out_of_order
from tests.services import SERVICES, node_of

TICK_NS = 10_000_000


@pytest.fixture(scope="module")
def messages() -> list[Message]:
    """Odd messages after the codec, with read-only arrays."""
    return [decode(encode(message)) for message in itertools.chain(in_order(), out_of_order())]


@pytest.mark.slow
@pytest.mark.parametrize("service", SERVICES)
def test_odd_messages_do_not_make_a_node_raise(
    service: str, messages: list[Message], tmp_path: Path
) -> None:
    node = node_of(service, tmp_path)
    for now_ns, message in zip(itertools.count(0, TICK_NS), messages):
        if isinstance(message, node.inputs):
            for answer in (*node.handle(message, now_ns), *node.tick(now_ns)):
                assert decode(encode(answer))
            assert node.status().state != "finished"
    node.close()
