"""Access to the page: roles by token, checks of Host and Origin, security headers."""

import re
import socket
from dataclasses import dataclass
from ipaddress import ip_address

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from services.dashboard.address import Tokens, is_local
from services.dashboard.config import DashboardConfig

COOKIE = "people4d"
OPEN_PATHS = ("/login", "/login.html", "/style.css", "/icon.svg")  # paths without a token
LOGIN = "/login.html"
HOST = re.compile(r"(\[[0-9a-f:.]+\]|[\w.-]+)(?::\d{0,5})?")  # name or address, and port
POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' blob:",
        "connect-src 'self'",
        "form-action 'self'",
        "base-uri 'none'",
        "frame-ancestors 'none'",
    )
)
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    # with no-referrer, browsers would send the form of the login without its Origin
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
    "Cache-Control": "no-cache",
}


@dataclass(frozen=True)
class Guard:
    """Checks every request before the application, as ASGI middleware.

    The check of Host rejects names of other sites for this machine's address (DNS rebinding). The
    check of Origin rejects requests from pages of other sites.

    Attributes:
        app: The application; the role is in scope["role"].
        tokens: Tokens of the roles; without an operator's token every viewer is operator.
        hosts: Valid names in Host, without port.
        secure: The page is served by https.
    """

    app: ASGIApp
    tokens: Tokens
    hosts: frozenset[str]
    secure: bool = False

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on with its role."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] in ("http.response.start", "websocket.http.response.start"):
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers[name] = value
            await send(message)

        answer = self._refusal(scope)
        if answer is None:
            await self.app(scope, receive, send_with_headers)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008, "reason": "refused"})
        else:
            await answer(scope, receive, send_with_headers)

    def _refusal(self, scope: Scope) -> Response | None:
        """Return the refusal of a request, or None and set its role."""
        request = HTTPConnection(scope)
        host = request.headers.get("host", "")
        name = _name(host)
        if name not in self.hosts and not _is_address(name):
            return PlainTextResponse("Host is not one of dashboard.allowed_hosts.\n", 421)
        changes = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")
        if changes and not self._same_origin(request.headers.get("origin"), host):
            return PlainTextResponse("Origin is another site.\n", 403)
        if not self.tokens.operator:
            scope["role"] = "operator"
            return None
        given = request.query_params.get("token", "")
        role = self.tokens.role_of(given)
        if role and scope["type"] == "http" and scope["path"] == "/":
            answer = RedirectResponse("/", 303)
            self.set_cookie(answer, given)
            return answer
        scope["role"] = self.tokens.role_of(request.cookies.get(COOKIE, ""))
        if scope["role"] or (scope["type"] == "http" and scope["path"] in OPEN_PATHS):
            return None
        if scope["type"] == "http" and scope["path"] == "/":
            return RedirectResponse(LOGIN, 303)
        return PlainTextResponse("A token is required.\n", 401)

    def set_cookie(self, answer: Response, token: str) -> None:
        """Store a token in the browser."""
        answer.set_cookie(
            *(COOKIE, token), httponly=True, samesite="strict", secure=self.secure, path="/"
        )

    def _same_origin(self, origin: str | None, host: str) -> bool:
        if not origin:  # browsers always send it
            return bool(self.tokens.operator)
        scheme = "https" if self.secure else "http"
        return origin.lower() == f"{scheme}://{host.lower()}"


def allowed_hosts(config: DashboardConfig) -> frozenset[str]:
    """Return the names of this machine that browsers may use, as well as addresses."""
    own = {"localhost", config.host, *config.allowed_hosts}
    if not is_local(config.host):
        own |= {socket.gethostname(), f"{socket.gethostname()}.local"}
    return frozenset(name.lower() for name in own)


def _is_address(name: str) -> bool:
    """Check that a Host is an address, which DNS rebinding cannot forge."""
    try:
        ip_address(name.strip("[]"))
    except ValueError:
        return False
    return True


def _name(host: str) -> str:
    """Return a Host without its port; empty if it is invalid."""
    match = HOST.fullmatch(host.lower())
    return match[1] if match else ""
