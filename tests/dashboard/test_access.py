"""Access to the page: Host, Origin, tokens, headers, paths, sizes."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgspec
import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from people4d.errors import ConfigError
from people4d.messages import TargetCommand, ZoneEdit
from services.dashboard.access import allowed_hosts
from services.dashboard.address import Tokens, read_tokens
from services.dashboard.check import check_page
from services.dashboard.config import DashboardConfig
from services.dashboard.history import History
from services.dashboard.hub import Hub
from services.dashboard.web import BODY_MAX, VIEWERS_MAX, WebApp

OWN = "http://localhost:7480"
OPEN = Tokens()
TOKENS = Tokens("operator-token", "planner-token")
STREAM = "ws://localhost:7480/stream"
SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]


class Page:
    """The application and its clients."""

    def __init__(self, tokens: Tokens = OPEN) -> None:
        self.commands: list[ZoneEdit | TargetCommand] = []
        self.hub = Hub(History(60, 2**20), lambda _: None)
        hosts = allowed_hosts(DashboardConfig(allowed_hosts=("robot.lan",)))
        app = WebApp(self.hub, tokens, hosts, self.commands.append)
        self.guard = app.guard

    def client(self, token: str = "", origin: str | None = OWN, base: str = OWN) -> TestClient:
        headers = {"origin": origin} if origin else {}
        client = TestClient(self.guard, base, headers=headers, follow_redirects=False)
        if token:
            client.cookies.set("people4d", token)
        return client


@pytest.fixture
def page() -> Page:
    return Page()


@pytest.fixture
def locked() -> Page:
    return Page(TOKENS)


def refuses(client: TestClient) -> bool:
    """Return True if the stream is refused."""
    try:
        url = str(client.base_url).replace("http", "ws", 1).rstrip("/")
        with client.websocket_connect(f"{url}/stream") as socket:
            socket.receive_bytes()
    except WebSocketDisconnect as error:
        return error.code in (1008, 1013)
    return False


def test_page_is_served_with_a_policy_that_allows_nothing_inline(page: Page) -> None:
    answer = page.client().get("/")
    assert answer.status_code == 200
    assert "people4d" in answer.text
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert answer.headers["x-content-type-options"] == "nosniff"


def test_page_has_neither_inline_script_nor_style(page: Page) -> None:
    for name in ("/", "/login.html"):
        text = page.client().get(name).text
        assert " style=" not in text
        assert "<style" not in text
        assert text.count("<script") == text.count("<script src=")


@pytest.mark.parametrize(
    "host",
    [
        *("evil.example", "evil.example:7480", "localhost.evil.example"),
        *("localhost:7480@evil.example", "localhost:7480:1", "localhost evil.example"),
        *("127.0.0.1:7480@evil.example", "127.0.0.1.evil.example"),
    ],
)
def test_name_of_another_site_as_host_is_refused(page: Page, host: str) -> None:
    client = page.client(origin=f"http://{host}")
    assert client.get("/", headers={"host": host}).status_code == 421
    assert client.put("/zones", headers={"host": host}).status_code == 421
    assert not page.commands


@pytest.mark.parametrize("host", ["robot.lan:7480", "192.168.1.5:7480", "[fe80::1]:7480"])
def test_configured_name_or_address_as_host_is_served(page: Page, host: str) -> None:
    assert page.client(base=f"http://{host}").get("/").status_code == 200


@pytest.mark.parametrize(
    "origin",
    [
        *("http://evil.example", "https://localhost:7480", "http://localhost:1", "null", None),
        *("http://[", "http://localhost:7480@evil.example", "://", "http://[::1]:x"),
    ],
)
def test_stream_and_edits_are_refused_to_other_origins(page: Page, origin: str | None) -> None:
    client = page.client(origin=origin)
    assert refuses(client)
    assert client.put("/zones", json={"base": 0, "zones": []}).status_code == 403
    assert not page.commands


def test_stream_is_served_to_the_own_origin(page: Page) -> None:
    with page.client().websocket_connect(STREAM) as socket:
        about = msgspec.msgpack.decode(socket.receive_bytes())
    assert (about["type"], about["role"]) == ("about", "operator")


def test_without_a_token_only_the_login_is_served(locked: Page) -> None:
    client = locked.client()
    assert client.get("/").headers["location"] == "/login.html"
    assert client.get("/login.html").status_code == 200
    assert client.get("/js/main.js").status_code == 401
    assert client.put("/zones", json={"base": 0, "zones": []}).status_code == 401
    assert refuses(client)


@pytest.mark.parametrize("token", ["wrong", "operator-toke", ""])
def test_wrong_token_is_refused(locked: Page, token: str) -> None:
    assert locked.client().get("/", params={"token": token}).headers["location"] == "/login.html"
    client = locked.client()
    client.headers["cookie"] = f"people4d={token}".encode("latin-1", "replace").decode("latin-1")
    assert client.get("/js/main.js").status_code == 401


def test_token_in_the_address_becomes_a_cookie_that_scripts_and_other_sites_do_not_get(
    locked: Page,
) -> None:
    client = locked.client()
    answer = client.get("/", params={"token": TOKENS.operator})
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    assert client.get("/js/main.js").status_code == 200


def test_login_with_the_form(locked: Page) -> None:
    client = locked.client()
    wrong = client.post("/login", content="token=wrong")
    assert wrong.headers["location"] == "/login.html#wrong"
    right = client.post("/login", content=f"token={TOKENS.planner}")
    assert right.headers["location"] == "/"
    assert client.get("/").status_code == 200


def test_login_with_a_huge_token_is_refused_and_counted(locked: Page) -> None:
    answer = locked.client().post("/login", content=b"token=" + b"x" * 3000)
    assert (answer.status_code, answer.text) == (400, "expected at most 1024 bytes\n")
    assert locked.hub.counters["bad_requests"] == 1


def test_planner_edits_no_zones(locked: Page) -> None:
    client = locked.client(TOKENS.planner)
    assert client.put("/zones", json={"base": 0, "zones": []}).status_code == 403


def test_zones_of_the_operator_are_taken(page: Page) -> None:
    zone = {"name": " door ", "corners_m": SQUARE, "dwell_s": 3, "count": None}
    answer = page.client().put("/zones", json={"base": 2, "zones": [zone]})
    assert answer.status_code == 202
    (edit,) = page.commands
    assert isinstance(edit, ZoneEdit)
    assert (edit.base, edit.zones[0].name, edit.zones[0].dwell_s) == (2, "door", 3.0)


@pytest.mark.parametrize(
    ("zone", "problem"),
    [
        ({"name": "x", "corners_m": [[0, 0], [1, 1], [1, 0], [0, 1]]}, "cross"),
        ({"name": "x", "corners_m": [[0, 0], [1, 1]]}, "3 to 64"),
        ({"name": "", "corners_m": SQUARE}, "name"),
        ({"name": "x\n", "corners_m": [[0, 0], [1, 0], [2, 0]]}, "cross"),
        ({"name": "a\nb", "corners_m": SQUARE}, "printable"),
        ({"name": "x", "corners_m": SQUARE, "count": 0}, "count"),
        ({"name": "x", "corners_m": SQUARE, "other": 0}, "other"),
    ],
)
def test_invalid_zone_is_refused_with_its_reason(
    page: Page, zone: dict[str, Any], problem: str
) -> None:
    answer = page.client().put("/zones", json={"base": 0, "zones": [zone]})
    assert answer.status_code == 400
    assert problem in answer.text
    assert not page.commands
    assert page.hub.counters["bad_requests"] == 1


@pytest.mark.parametrize("token", [TOKENS.operator, TOKENS.planner])
def test_both_roles_choose_the_followed_person(locked: Page, token: str) -> None:
    for id_ in (7, None):
        assert locked.client(token).post("/target", json={"id": id_}).status_code == 202
    chosen = [(c.action, c.id, c.chooser) for c in locked.commands if isinstance(c, TargetCommand)]
    assert chosen == [("id", 7, "dashboard"), ("none", None, "dashboard")]


@pytest.mark.parametrize("body", [{"id": 0}, {"id": "7"}, {}, {"id": 7, "other": 1}, []])
def test_invalid_choice_is_refused_and_counted(page: Page, body: Any) -> None:
    assert page.client().post("/target", json=body).status_code == 400
    assert not page.commands
    assert page.hub.counters["bad_requests"] == 1


def test_choice_by_another_site_or_without_a_token_is_refused(page: Page, locked: Page) -> None:
    foreign = page.client(origin="http://evil.example")
    assert foreign.post("/target", json={"id": 7}).status_code == 403
    assert locked.client().post("/target", json={"id": 7}).status_code == 401
    assert not page.commands
    assert not locked.commands


def test_huge_body_is_refused(page: Page) -> None:
    answer = page.client().put("/zones", content=b" " * (BODY_MAX + 1))
    assert answer.status_code == 400
    assert "bytes" in answer.text


@pytest.mark.parametrize(
    "path",
    [
        *("/../config.py", "/%2e%2e/config.py", "/..%2fconfig.py", "/js/..%2f..%2fconfig.py"),
        *("//etc/passwd", "/%2fetc/passwd", "/js\\..\\..\\config.py", "/js/%00"),
    ],
)
def test_path_does_not_leave_the_page(page: Page, path: str) -> None:
    answer = page.client().get(path)
    assert answer.status_code in (400, 404)
    assert "DashboardConfig" not in answer.text


@pytest.mark.parametrize("frame", [b"", b"\xc1", b"\x81\xa1a\x01", b"\x92" * 500, b"\x00"])
def test_frame_that_is_no_request_ends_the_stream_and_is_counted(page: Page, frame: bytes) -> None:
    with page.client().websocket_connect(STREAM) as socket:
        socket.send_bytes(frame)
        assert closes_with(socket.receive) == 1008
    assert page.hub.counters["bad_requests"] == 1


def test_text_frame_ends_the_stream(page: Page) -> None:
    with page.client().websocket_connect(STREAM) as socket:
        socket.send_text("hello")
        assert closes_with(socket.receive) == 1008


def test_too_many_requests_end_the_stream(page: Page) -> None:
    with page.client().websocket_connect(STREAM) as socket:
        for _ in range(1000):
            socket.send_bytes(msgspec.msgpack.encode({"type": "pause"}))
        assert closes_with(socket.receive) == 1008


def test_more_viewers_than_allowed_are_refused(page: Page) -> None:
    with ExitStack() as stack:
        for _ in range(VIEWERS_MAX):
            socket = stack.enter_context(page.client().websocket_connect(STREAM))
            socket.receive_bytes()
        assert refuses(page.client())
    assert page.hub.counters["viewers_refused"] == 1
    assert page.hub.viewers == 0


def closes_with(receive: Callable[[], Any]) -> int:
    """Return the close code of a stream."""
    while (message := receive())["type"] == "websocket.send":
        pass
    code: int = message["code"]
    return code


def test_tokens_are_made_once_and_only_for_their_owner(tmp_path: Path) -> None:
    tokens = read_tokens("0.0.0.0", Tokens(), tmp_path)
    assert min(len(tokens.operator), len(tokens.planner)) >= 32
    assert tokens.operator != tokens.planner
    assert read_tokens("0.0.0.0", Tokens(), tmp_path) == tokens
    (file,) = tmp_path.iterdir()
    assert file.stat().st_mode & 0o777 == 0o600


def test_damaged_file_of_tokens_is_replaced(tmp_path: Path) -> None:
    first = read_tokens("0.0.0.0", Tokens(), tmp_path)
    next(tmp_path.iterdir()).write_bytes(b"{")
    assert read_tokens("0.0.0.0", Tokens(), tmp_path).operator not in ("", first.operator)


def test_this_machine_alone_needs_no_token(tmp_path: Path) -> None:
    assert read_tokens("127.0.0.1", Tokens(), tmp_path) == Tokens()
    assert read_tokens("127.0.0.1", Tokens("t"), tmp_path).operator == "t"


def test_certificate_without_its_key_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="belong together"):
        check_page(DashboardConfig(certificate="a.pem"))
    with pytest.raises(ConfigError, match="does not exist"):
        check_page(DashboardConfig(certificate="a.pem", certificate_key="b.pem"))
