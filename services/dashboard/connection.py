"""Connections of the web server, with a time limit for headers and a limit of idle ones."""

import asyncio
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

HEADERS_S = 5.0  # maximum time for the headers of a request to arrive [s]


class PageConnection(H11Protocol):
    """HTTP connection; at the limit, a new one replaces the oldest without a request."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self._timer: asyncio.TimerHandle | None = None
        self._begin_s = self.loop.time()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Handle a new connection."""
        idle = [one for one in self.connections if isinstance(one, PageConnection) and one.is_idle]
        if self.limit_concurrency and len(self.connections) >= self.limit_concurrency - 1 and idle:
            min(idle, key=lambda one: one._begin_s).abort()
        super().connection_made(transport)
        self._expect_headers()

    def data_received(self, data: bytes) -> None:
        """Handle received bytes."""
        super().data_received(data)
        if self.is_idle:
            self._expect_headers()
        else:
            self._stop_timer()

    def connection_lost(self, exc: Exception | None) -> None:
        """Handle the end of the connection."""
        self._stop_timer()
        super().connection_lost(exc)

    @property
    def is_idle(self) -> bool:
        """True without a request in progress, until it becomes a WebSocket."""
        worked_on = self.cycle is not None and not self.cycle.response_complete
        return self in self.connections and not worked_on

    def abort(self) -> None:
        """Close the connection at once."""
        self.connections.discard(self)
        self.transport.abort()

    def _expect_headers(self) -> None:
        if self._timer is None:
            self._timer = self.loop.call_later(HEADERS_S, self.abort)

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
