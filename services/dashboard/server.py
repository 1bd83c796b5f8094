"""Web server in a separate thread."""

import asyncio
import errno
import logging
import socket
import ssl
import threading
from collections.abc import Callable
from pathlib import Path

import msgspec
import uvicorn
from starlette.types import ASGIApp

from common.io.files import write_private
from people4d.errors import ConfigError
from people4d.messages import TargetCommand, ZoneEdit
from services.dashboard.access import allowed_hosts
from services.dashboard.address import ADDRESS_FILE, PageAddress, Tokens, read_tokens
from services.dashboard.config import DashboardConfig
from services.dashboard.connection import PageConnection
from services.dashboard.hub import Hub
from services.dashboard.web import REQUEST_MAX, VIEWERS_MAX, WebApp

STOP_S = 3.0  # maximum wait for the end of the server [s]
BACKLOG = 128
PORTS = 10  # number of ports that are tried
DEAD_MS = 20_000  # maximum time without acknowledgement of sent data [ms]

log = logging.getLogger("people4d")


class WebServer:
    """Serves a page until closed.

    ConfigError if the port is taken, or certificate or state folder cannot be used.

    Args:
        config: Address and access.
        app_of: Application for the tokens of the roles.
        folder: Folder of the robot's state, or None.
        attach: Called with the server's event loop, and with None at its end.
    """

    def __init__(
        self,
        config: DashboardConfig,
        app_of: Callable[[Tokens], ASGIApp],
        folder: Path | None = None,
        attach: Callable[[asyncio.AbstractEventLoop | None], None] = lambda _: None,
    ) -> None:
        self._attach = attach
        try:
            given = Tokens(config.operator_token, config.planner_token)
            tokens = read_tokens(config.host, given, folder)
        except OSError as error:
            raise ConfigError(f"tokens of the dashboard cannot be stored: {error}") from error
        secure = bool(config.certificate)
        self._socket = _listen(config.host, config.port)
        settings = uvicorn.Config(
            app_of(tokens),
            log_level="warning",
            access_log=False,
            lifespan="off",
            http=PageConnection,
            server_header=False,
            ws="websockets-sansio",
            ws_max_size=REQUEST_MAX,
            ws_per_message_deflate=False,
            ws_ping_interval=10.0,
            ws_ping_timeout=20.0,
            timeout_keep_alive=5,
            timeout_graceful_shutdown=1,
            limit_concurrency=4 * VIEWERS_MAX + 64,
            h11_max_incomplete_event_size=16384,
            ssl_certfile=config.certificate or None,
            ssl_keyfile=config.certificate_key or None,
        )
        try:
            settings.load()
        except (OSError, ssl.SSLError) as error:
            self._socket.close()
            raise ConfigError(f"certificate of the dashboard cannot be used: {error}") from error
        self._server = uvicorn.Server(settings)
        self.address = PageAddress(_url(config, self._socket, secure), tokens)
        if folder:
            write_private(folder / ADDRESS_FILE, msgspec.json.encode(self.address))
        self._thread = threading.Thread(target=self._run, name="web server", daemon=True)
        self._thread.start()
        log.info("dashboard at %s", self.address.url)

    def close(self) -> None:
        """End all connections and the server."""
        self._server.should_exit = True
        self._thread.join(STOP_S)
        self._socket.close()

    def _run(self) -> None:
        asyncio.run(self._serve())

    async def _serve(self) -> None:
        self._attach(asyncio.get_running_loop())
        try:
            await self._server.serve([self._socket])
        finally:
            self._attach(None)


def serve_dashboard(
    config: DashboardConfig,
    hub: Hub,
    on_command: Callable[[ZoneEdit | TargetCommand], None],
    folder: Path | None,
) -> WebServer:
    """Serve the dashboard to viewers; `on_command` is called with their commands."""

    def app_of(tokens: Tokens) -> ASGIApp:
        secure = bool(config.certificate)
        return WebApp(hub, tokens, allowed_hosts(config), on_command, secure).guard

    return WebServer(config, app_of, folder, hub.attach)


def _listen(host: str, port: int) -> socket.socket:
    """Listen at a port, or at the first free port after it."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    last = min(port + PORTS - 1, 65535) if port else 0
    for one in range(port, last + 1):
        try:
            listener = socket.create_server(
                (host, one), family=family, backlog=BACKLOG, dualstack_ipv6=host == "::"
            )
        except OSError as error:
            if error.errno == errno.EADDRINUSE and one < last:
                continue
            raise ConfigError(
                f"the dashboard cannot listen at {host}:{one} ({error.strerror or error})",
                "Does another one run there? Else --set dashboard.port=NUMBER.",
            ) from error
        if one != port:
            log.warning("port %d is taken, the dashboard listens at %d", port, one)
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, DEAD_MS)
        return listener
    raise AssertionError("the last port is refused by an error")


def _url(config: DashboardConfig, listener: socket.socket, secure: bool) -> str:
    host, port = config.host, listener.getsockname()[1]
    if host in ("0.0.0.0", "::"):
        host = socket.gethostname()
    elif ":" in host:
        host = f"[{host}]"
    return f"{'https' if secure else 'http'}://{host}:{port}/"
