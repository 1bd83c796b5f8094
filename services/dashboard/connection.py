"""Connections of the web server: a request's headers have to come in time, idle ones make room."""

import asyncio
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

HEADERS_S = 5.0  # in which the headers of a request have to come


class PageConnection(H11Protocol):
    """A connection by HTTP; the oldest without a request is closed where there are too many."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self._timer: asyncio.TimerHandle | None = None
        self._begin_s = self.loop.time()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a new connection."""
        idle = [one for one in self.connections if isinstance(one, PageConnection) and one.is_idle]
        if self.limit_concurrency and len(self.connections) >= self.limit_concurrency - 1 and idle:
            min(idle, key=lambda one: one._begin_s).abort()
        super().connection_made(transport)
        self._expect_headers()

    def data_received(self, data: bytes) -> None:
        """Take bytes."""
        super().data_received(data)
        if self.is_idle:
            self._expect_headers()
        else:
            self._stop_timer()

    def connection_lost(self, exc: Exception | None) -> None:
        """Take note of the end."""
        self._stop_timer()
        super().connection_lost(exc)

    @property
    def is_idle(self) -> bool:
        """True without a request that is worked on, until it becomes a WebSocket."""
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
