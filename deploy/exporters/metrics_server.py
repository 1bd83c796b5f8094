"""Server of /metrics with a limited number of connections."""

import contextlib
import socket
import threading
from collections import deque
from socketserver import TCPServer, ThreadingMixIn
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

from prometheus_client import CollectorRegistry, make_wsgi_app

CONNECTIONS_MAX = 32  # maximum number of connections, each with a thread
READ_S = 5.0  # maximum wait for the next bytes of a request [s]


class MetricsServer:
    """Serves a registry until closed; OSError if it cannot listen at the address."""

    def __init__(self, address: str, port: int, registry: CollectorRegistry) -> None:
        kind = _ServerIPv6 if ":" in address else _Server
        self._server = make_server(address, port, make_wsgi_app(registry), kind, _Handler)
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """Port of the server."""
        return self._server.server_port

    def close(self) -> None:
        """End the server."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Handler(WSGIRequestHandler):
    """Handler of one connection."""

    timeout = READ_S

    def handle(self) -> None:
        """Answer one request, or ignore a broken connection."""
        with contextlib.suppress(OSError):
            super().handle()

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing."""


class _Server(ThreadingMixIn, WSGIServer):
    """Server that closes the oldest of too many connections."""

    daemon_threads = True
    request_queue_size = 128

    def __init__(self, *arguments: Any) -> None:
        self._open: deque[Any] = deque()
        super().__init__(*arguments)

    def server_bind(self) -> None:
        """Bind the socket without the base class's DNS look-up of its name."""
        TCPServer.server_bind(self)
        host, self.server_port = self.server_address[:2]
        self.server_name = str(host)
        self.setup_environ()

    def process_request(self, request: Any, client_address: Any) -> None:
        """Start a thread for a connection."""
        self._open.append(request)
        if len(self._open) > CONNECTIONS_MAX:
            with contextlib.suppress(OSError):
                self._open.popleft().shutdown(socket.SHUT_RDWR)
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """Close a connection."""
        with contextlib.suppress(ValueError):
            self._open.remove(request)
        super().shutdown_request(request)


class _ServerIPv6(_Server):
    address_family = socket.AF_INET6
