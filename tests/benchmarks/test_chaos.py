"""The plan of a chaos soak, and the link that it cuts."""

import socket
import threading

import pytest

from benchmarks.lib.chaos.plan import CALM_S, KINDS, plan
from benchmarks.lib.chaos.tcp_proxy import TcpProxy

TIMEOUT_S = 10.0


def test_plan_follows_from_the_seed_alone() -> None:
    assert plan(7, 30.0) == plan(7, 30.0) != plan(8, 30.0)


def test_plan_of_half_an_hour_holds_every_kind_and_ends_in_calm() -> None:
    planned = plan(1, 30.0)
    assert {p.kind for p in planned} == set(KINDS)
    assert all(CALM_S <= p.at_s <= 30 * 60 - CALM_S - p.duration_s for p in planned)
    assert [p.at_s for p in planned] == sorted(p.at_s for p in planned)


@pytest.fixture
def echo_port() -> int:
    """A server that returns what it gets."""
    listener = socket.create_server(("127.0.0.1", 0))

    def echo(connection: socket.socket) -> None:
        with connection:
            while data := connection.recv(100):
                connection.sendall(data)

    def accept() -> None:
        while True:
            connection, _ = listener.accept()
            threading.Thread(target=echo, args=(connection,), daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    port: int = listener.getsockname()[1]
    return port


def connect(proxy: TcpProxy) -> socket.socket:
    port = int(proxy.endpoint.rpartition(":")[2])
    return socket.create_connection(("127.0.0.1", port), TIMEOUT_S)


def ends(connection: socket.socket) -> bool:
    try:
        return connection.recv(3) == b""
    except ConnectionError:
        return True


def test_silent_cut_holds_bytes_until_it_is_restored(echo_port: int) -> None:
    with TcpProxy(echo_port) as proxy, connect(proxy) as client:
        client.sendall(b"one")
        assert client.recv(3) == b"one"
        proxy.cut(reset=False)
        client.sendall(b"two")
        client.settimeout(0.3)
        with pytest.raises(TimeoutError):
            client.recv(3)
        client.settimeout(TIMEOUT_S)
        proxy.restore()
        assert client.recv(3) == b"two"


def test_reset_cut_ends_connections_and_refuses_new_ones(echo_port: int) -> None:
    with TcpProxy(echo_port) as proxy, connect(proxy) as client:
        client.sendall(b"one")
        assert client.recv(3) == b"one"
        proxy.cut(reset=True)
        assert ends(client)
        with connect(proxy) as refused:
            assert refused.recv(1) == b""
        proxy.restore()
        with connect(proxy) as again:
            again.sendall(b"two")
            assert again.recv(3) == b"two"
