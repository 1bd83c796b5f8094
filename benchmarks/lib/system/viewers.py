"""Viewers of the page of the dashboard without a browser: they read what they are sent."""

import asyncio
import multiprocessing
import os
import socket
from base64 import b64encode
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from urllib.parse import urlsplit

import msgspec
from websockets.asyncio.client import connect
from websockets.typing import Origin

NICENESS = 19  # they stand for other machines
END_S = 20.0
WATCH = msgspec.msgpack.encode({"type": "watch", "images": True, "cloud": False})


@contextmanager
def viewers(url: str, count: int) -> Iterator[Callable[[], int]]:
    """Open a number of pages in a process of their own until the block ends.

    Yields:
        Returns the number of images that the first one got.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(url, count, theirs), daemon=True)

    def images() -> int:
        ours.send(None)
        count: int = ours.recv()
        return count

    process.start()
    try:
        yield images
    finally:
        process.kill()
        process.join(END_S)


def _serve(url: str, count: int, pipe: Connection) -> None:
    os.nice(NICENESS)
    asyncio.run(_view_all(url, count, pipe))


async def _view_all(url: str, count: int, pipe: Connection) -> None:
    images = [0] * count

    async def view(number: int) -> None:
        stream = f"{url.replace('http', 'ws', 1)}stream"
        async with connect(stream, origin=Origin(url.rstrip("/")), max_size=None) as socket:
            await socket.send(WATCH)
            async for data in socket:
                images[number] += b"\xa5image" in data[:16]

    async def answer() -> None:
        while True:
            if pipe.poll():
                pipe.recv()
                pipe.send(sum(images[:1]))
            await asyncio.sleep(0.05)

    await asyncio.gather(answer(), *map(view, range(count)))


def silent_viewer(url: str) -> socket.socket:
    """Open a stream, ask for images, and read nothing."""
    parts = urlsplit(url)
    viewer = socket.create_connection((parts.hostname, parts.port))
    key = b64encode(os.urandom(16)).decode()
    lines = (
        "GET /stream HTTP/1.1",
        f"Host: {parts.netloc}",
        f"Origin: {url.rstrip('/')}",
        "Upgrade: websocket",
        "Connection: Upgrade",
        f"Sec-WebSocket-Key: {key}",
        "Sec-WebSocket-Version: 13",
    )
    viewer.sendall("\r\n".join([*lines, "", ""]).encode())
    return viewer
