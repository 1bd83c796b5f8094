"""Server and file of Foxglove's messages, by its SDK."""

import json
from pathlib import Path

import foxglove
from foxglove import Channel, Context
from foxglove.websocket import WebSocketServer

from deploy.viewers.foxglove_messages import JSON_SCHEMAS, Content, FoxgloveConverter
from people4d.errors import ConfigError, SourceError
from people4d.messages import Message

BACKLOG = 256  # maximum number of messages that wait for a slow client; the oldest are dropped


class FoxgloveOutput:
    """Converts messages and logs them in a context; channels open with their first message."""

    def __init__(self, converter: FoxgloveConverter) -> None:
        self._converter, self._context = converter, Context()
        self._channels: dict[str, Channel] = {}

    def write(self, message: Message, log_time_ns: int) -> None:
        """Log a message with its time of reception."""
        for topic, content in self._converter.convert(message, log_time_ns):
            if topic not in self._channels:
                self._channels[topic] = self._open_channel(topic, content)
            data = (
                json.dumps(content, allow_nan=False).encode()
                if isinstance(content, dict)
                else content.encode()
            )
            self._channels[topic].log(data, log_time=max(log_time_ns, 0))

    def _open_channel(self, topic: str, content: Content) -> Channel:
        if isinstance(content, dict):
            return Channel(topic, schema=JSON_SCHEMAS[topic], context=self._context)
        schema = content.get_schema()
        return Channel(topic, schema=schema, message_encoding="protobuf", context=self._context)


class FoxgloveServer(FoxgloveOutput):
    """Serves messages to Foxglove's app by its WebSocket protocol.

    ConfigError if the address is in use, or not an address of this machine.

    Args:
        converter: Converts the messages.
        host: Address of the server.
        port: TCP port; 0: a free one.
    """

    def __init__(self, converter: FoxgloveConverter, host: str, port: int) -> None:
        super().__init__(converter)
        try:
            self._server: WebSocketServer = foxglove.start_server(
                name="people4d",
                host=host,
                port=port,
                context=self._context,
                message_backlog_size=BACKLOG,
            )
        except RuntimeError as error:
            raise ConfigError(
                f"no server at {host}:{port}: {error}", "Choose another --port."
            ) from error
        self.port = self._server.port

    def close(self) -> None:
        """Stop the server."""
        self._server.stop()


class FoxgloveFile(FoxgloveOutput):
    """Writes a compressed, indexed MCAP file of Foxglove's messages; SourceError if it cannot."""

    def __init__(self, converter: FoxgloveConverter, path: Path) -> None:
        super().__init__(converter)
        self._path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = foxglove.open_mcap(path, allow_overwrite=True, context=self._context)
        except (OSError, RuntimeError) as error:
            raise SourceError(f"{path} cannot be written: {error}") from error

    def close(self) -> None:
        """Finish the file."""
        try:
            self._file.close()
        except (OSError, RuntimeError) as error:
            raise SourceError(f"{self._path} cannot be written: {error}") from error
