"""A TCP proxy whose link can be cut: silently, as by a pulled cable, or with a reset."""

import contextlib
import select
import socket
import struct
import threading
from types import TracebackType

CHUNK = 65536
POLL_S = 0.05
RESET = struct.pack("ii", 1, 0)  # SO_LINGER: close with RST


class TcpProxy:
    """Forwards connections to a port of this machine until closed.

    Args:
        port: Port that it forwards to.
    """

    def __init__(self, port: int) -> None:
        self._target = ("127.0.0.1", port)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._listener.getsockname()[1]}"
        self._cut, self._closed = threading.Event(), threading.Event()
        self._open: set[socket.socket] = set()
        threading.Thread(target=self._accept, daemon=True).start()

    def __enter__(self) -> "TcpProxy":
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close all."""
        self._closed.set()
        self._listener.close()
        self._reset()

    def cut(self, reset: bool) -> None:
        """Forward nothing any more, in either direction.

        Args:
            reset: Close all connections and refuse new ones; otherwise they stay open in silence.
        """
        self._cut.set()
        if reset:
            self._reset()

    def restore(self) -> None:
        """Forward again; connections that fell silent go on where they were."""
        self._cut.clear()

    def _reset(self) -> None:
        for connection in list(self._open):
            with contextlib.suppress(OSError):
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
                connection.shutdown(socket.SHUT_RDWR)

    def _accept(self) -> None:
        while not self._closed.is_set():
            try:
                near, _ = self._listener.accept()
                far = socket.create_connection(self._target) if not self._cut.is_set() else None
            except OSError:
                continue
            if far is None:
                near.close()
                continue
            threading.Thread(target=self._forward, args=(near, far), daemon=True).start()

    def _forward(self, near: socket.socket, far: socket.socket) -> None:
        self._open |= {near, far}
        other = {near: far, far: near}
        try:
            while not self._closed.is_set():
                if self._cut.is_set():
                    self._closed.wait(POLL_S)
                    if near.fileno() < 0:
                        return
                    continue
                for ready in select.select([near, far], [], [], POLL_S)[0]:
                    data = ready.recv(CHUNK)
                    if not data:
                        return
                    other[ready].sendall(data)
        except OSError:
            return
        finally:
            self._open -= {near, far}
            near.close()
            far.close()
