"""Outputs of Foxglove's messages: a WebSocket server, a file of theirs, a recording of ours."""

from collections.abc import Callable
from pathlib import Path

import foxglove
from foxglove import Channel, Context, Schema
from foxglove.websocket import WebSocketServer

from common.io.recording import RecordingWriter
from deploy.viewers.foxglove_messages import FoxgloveConverter
from people4d.errors import ConfigError
from people4d.messages import Message

# Messages that wait for a slow client, whose oldest are dropped beyond.
BACKLOG = 256


class _Channels:
    """Channels of a context, made as their first messages come."""

    def __init__(self) -> None:
        self.context = Context()
        self._channels: dict[str, Channel] = {}

    def write(self, converter: FoxgloveConverter, message: Message, log_time_ns: int) -> None:
        for item in converter.convert(message, log_time_ns):
            if item.topic not in self._channels:
                schema = Schema(
                    name=item.schema_name, encoding=item.schema_encoding, data=item.schema
                )
                self._channels[item.topic] = Channel(
                    item.topic,
                    schema=schema,
                    message_encoding=item.encoding,
                    context=self.context,
                )
            self._channels[item.topic].log(item.data, log_time=max(log_time_ns, 0))


class FoxgloveServer:
    """Serves messages to Foxglove's app by its WebSocket protocol.

    Args:
        converter: Converts the messages.
        host: Address to listen at.
        port: TCP port; 0: a free one.

    Raises:
        ConfigError: The address is in use or not of this machine.
    """

    def __init__(self, converter: FoxgloveConverter, host: str, port: int) -> None:
        self._converter, self._channels = converter, _Channels()
        try:
            self._server: WebSocketServer = foxglove.start_server(
                name="people4d",
                host=host,
                port=port,
                context=self._channels.context,
                message_backlog_size=BACKLOG,
            )
        except RuntimeError as error:
            raise ConfigError(
                f"no server at {host}:{port}: {error}", "Choose another --port."
            ) from error
        self.port = self._server.port

    def write(self, message: Message, log_time_ns: int) -> None:
        """Send a message to the clients."""
        self._channels.write(self._converter, message, log_time_ns)

    def close(self) -> None:
        """Stop the server."""
        self._server.stop()


class FoxgloveFile:
    """Writes an MCAP file of Foxglove's messages alone, compressed and indexed.

    SourceError if it cannot be written.
    """

    def __init__(self, converter: FoxgloveConverter, path: Path) -> None:
        self._converter = converter
        self._writer = RecordingWriter(path, container="compressed")

    def write(self, message: Message, log_time_ns: int) -> None:
        """Append what a message is for Foxglove."""
        for item in self._converter.convert(message, log_time_ns):
            self._writer.write_foreign(item, log_time_ns)

    def close(self) -> None:
        """Finish the file."""
        self._writer.close()


class FoxgloveRecordingWriter(RecordingWriter):
    """A recording of ours with Foxglove's messages beside, indexed so that its app can seek."""

    def __init__(self, path: Path, converter: FoxgloveConverter) -> None:
        super().__init__(path, container="chunks")
        self._converter = converter

    def write(self, message: Message, log_time_ns: int) -> None:
        """Append a message and what it is for Foxglove."""
        super().write(message, log_time_ns)
        for item in self._converter.convert(message, log_time_ns):
            self.write_foreign(item, log_time_ns)


def recording_opener(make: Callable[[], FoxgloveConverter]) -> Callable[[Path], RecordingWriter]:
    """Return the function that opens a recording with a converter of its own."""
    return lambda path: FoxgloveRecordingWriter(path, make())
