"""Connections that ask nothing, or slowly, leave the page to others."""

import itertools
import re
import socket
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from services.dashboard.config import DashboardConfig
from services.dashboard.history import History
from services.dashboard.hub import Hub
from services.dashboard.server import WebServer, serve_dashboard
from services.dashboard.web import LOGINS_MAX

WAIT_S = 20.0
IMPATIENT_S = 0.5  # maximum wait of a server for headers and bodies [s]
HALF = b"GET /login.html HTTP/1.1\r\nHost: 127."


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.dashboard.connection.HEADERS_S", IMPATIENT_S)
    monkeypatch.setattr("services.dashboard.web.BODY_S", IMPATIENT_S)


@pytest.fixture
def server() -> Iterator[tuple[WebServer, Hub]]:
    hub = Hub(History(60, 2**20), lambda _: None)
    config = DashboardConfig(port=0, operator_token="operator-token")
    server = serve_dashboard(config, hub, lambda _: None, None)
    yield server, hub
    server.close()


def connect(server: WebServer, sent: bytes = b"") -> socket.socket:
    port = int(server.address.url.rstrip("/").rpartition(":")[2])
    connection = socket.create_connection(("127.0.0.1", port), WAIT_S)
    connection.sendall(sent.replace(b"PORT", str(port).encode()))
    return connection


def status(server: WebServer, request: bytes) -> int:
    """Return the status of an answer, 0 if there is none."""
    with connect(server, request) as connection:
        return status_of(connection)


def status_of(connection: socket.socket) -> int:
    try:
        match = re.match(rb"HTTP/1.1 (\d+)", connection.recv(4096))
    except ConnectionResetError:
        return 0
    return int(match[1]) if match else 0


def asks_for_page(server: WebServer) -> int:
    return status(server, b"GET /login.html HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\n\r\n")


def login(body: bytes, length: int) -> bytes:
    head = "POST /login HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\nOrigin: http://127.0.0.1:PORT\r\n"
    return f"{head}Content-Length: {length}\r\n\r\n".encode() + body


@pytest.mark.parametrize("sent", [b"", HALF], ids=["idle", "half a request"])
def test_page_is_served_beside_many_connections_that_ask_nothing(
    server: tuple[WebServer, Hub], sent: bytes
) -> None:
    with ExitStack() as stack:
        for _ in range(200):
            stack.enter_context(connect(server[0], sent))
        assert asks_for_page(server[0]) == 200


@pytest.mark.usefixtures("impatient")
def test_connection_whose_headers_do_not_come_in_time_is_closed(
    server: tuple[WebServer, Hub],
) -> None:
    with connect(server[0], HALF) as connection:
        connection.settimeout(0.1)
        for _ in range(int(WAIT_S / 0.1)):  # a byte now and then does not help
            try:
                connection.sendall(b"1")
                if connection.recv(1) == b"":
                    break
            except TimeoutError:
                continue
            except (ConnectionResetError, BrokenPipeError):
                break
        else:
            pytest.fail("it stays open")


@pytest.mark.usefixtures("impatient")
def test_body_after_an_answer_does_not_keep_a_connection_open(
    server: tuple[WebServer, Hub],
) -> None:
    head = b"PUT /zones HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\nContent-Length: 999\r\n\r\n"
    with connect(server[0], head) as connection:
        assert status_of(connection) == 401
        connection.sendall(b"x")
        while connection.recv(4096):  # until it is closed; else it times out
            pass


@pytest.mark.usefixtures("impatient")
def test_login_whose_body_does_not_come_is_refused(server: tuple[WebServer, Hub]) -> None:
    assert status(server[0], login(b"token=", 99)) == 400
    assert server[1].counters["bad_requests"] == 1


def test_logins_at_once_are_limited_and_the_page_is_served(server: tuple[WebServer, Hub]) -> None:
    with ExitStack() as stack:
        waiting = [stack.enter_context(connect(server[0], login(b"", 9))) for _ in range(80)]
        assert asks_for_page(server[0]) == 200
        answers = [status_of(one) for one in waiting]
    assert answers.count(400) <= LOGINS_MAX
    assert answers.count(503) >= 80 - LOGINS_MAX - 10  # the oldest may have made room


ODD_PATHS = (b"/login.html", b"/", b"/stream", b"http://[", b"//[", b"/%ff")
ODD_HEADERS = (
    *(b"Cookie: people4d=\xff\xfe", b"Cookie: =;;=a;", b"Cookie: people4d=\xc3\xa9"),
    *(b"Range: bytes=9-1,,-", b"Range: bytes=0-0,1-1", b"If-Modified-Since: x"),
    *(b"Origin: http://[", b"Content-Length: 3", b"Accept-Encoding: \xff", b"Upgrade: h2c"),
    *(b"Connection: Upgrade\r\nUpgrade: websocket", b"Transfer-Encoding: chunked"),
)


def test_malformed_requests_are_refused_without_an_exception(
    server: tuple[WebServer, Hub], caplog: pytest.LogCaptureFixture
) -> None:
    for path, header in itertools.product(ODD_PATHS, ODD_HEADERS):
        head = b"GET " + path + b" HTTP/1.1\r\nHost: 127.0.0.1\r\n"
        assert 0 < status(server[0], head + header + b"\r\n\r\n") < 500, (path, header)
    assert not [record for record in caplog.records if record.exc_info]
