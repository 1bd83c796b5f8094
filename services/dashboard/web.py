"""Web application of the page: its files, and WebSockets for its stream, people and commands."""

import asyncio
import time
from collections import deque
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Literal

import anyio
import msgspec
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from people4d.errors import DecodeError
from people4d.messages import TargetCommand, ZoneEdit
from people4d.messages.base import PositiveInt
from services.dashboard.access import Guard
from services.dashboard.address import Tokens
from services.dashboard.hub import Hub, Viewer
from services.dashboard.zones import ZonesRequest, zone_edit

PAGE = Path(__file__).with_name("page")
BODY_MAX = 256 * 1024  # maximum size of the body of a request [bytes]
REQUEST_MAX = 1024  # maximum size of a frame of the WebSocket [bytes]
REQUESTS_MAX = 120  # maximum number of requests of a viewer in a second
REFUSED, BUSY = 1008, 1013  # WebSocket close codes
VIEWERS_MAX = 32  # maximum number of open pages
STUCK_S = 5.0  # maximum time for a viewer to read a part [s]
BODY_S = 5.0  # maximum time for the body of a request to arrive [s]
LOGINS_MAX = 16  # maximum number of simultaneous logins
LOGIN_PAUSE_S = 0.5  # pause after a wrong token [s]


class PageRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Request of a page."""

    type: Literal["watch", "pause", "live", "seek"]
    images: bool = True  # request watch: send images
    cloud: bool = False  # request watch: send depth clouds
    at_ms: float = 0.0  # request seek on a paused page: wall clock of the packets [ms]


class FollowRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Request of a page to follow a person."""

    id: PositiveInt | None  # identity as in Tracks; None: no person


REQUESTS = msgspec.msgpack.Decoder(PageRequest)


class WebApp:
    """Serves the page.

    Args:
        hub: Viewers.
        tokens: Tokens of the roles.
        hosts: Names of this machine that browsers may use.
        on_command: Called with edits of zones, and with choices of the followed person.
        secure: The page is served by https.
    """

    def __init__(
        self,
        hub: Hub,
        tokens: Tokens,
        hosts: frozenset[str],
        on_command: Callable[[ZoneEdit | TargetCommand], None],
        secure: bool = False,
    ) -> None:
        self._hub, self._tokens, self._on_command = hub, tokens, on_command
        self._logins = 0
        routes: list[BaseRoute] = [
            WebSocketRoute("/stream", self._stream),
            WebSocketRoute("/people", self._stream),
            Route("/zones", self._edit_zones, methods=["PUT"]),
            Route("/target", self._follow_person, methods=["POST"]),
            Route("/login", self._login, methods=["POST"]),
            Mount("/", StaticFiles(directory=PAGE, html=True)),
        ]
        self.guard = Guard(Starlette(routes=routes), tokens, hosts, secure)

    async def _login(self, request: Request) -> Response:
        if self._logins >= LOGINS_MAX:
            self._hub.counters["viewers_refused"] += 1
            return PlainTextResponse("Too many logins at once.\n", 503)
        self._logins += 1
        try:
            return await self._check_login(
                (await read_body(request, REQUEST_MAX)).decode("latin-1")
            )
        except ValueError as error:
            return self._bad_request(error)
        finally:
            self._logins -= 1

    async def _check_login(self, body: str) -> Response:
        token = body.removeprefix("token=").strip()
        if not self._tokens.role_of(token):
            self._hub.counters["viewers_refused"] += 1
            await asyncio.sleep(LOGIN_PAUSE_S)
            return RedirectResponse("/login.html#wrong", 303)
        answer = RedirectResponse("/", 303)
        self.guard.set_cookie(answer, token)
        return answer

    async def _edit_zones(self, request: Request) -> Response:
        if request.scope["role"] != "operator":
            return PlainTextResponse("Only the operator edits zones.\n", 403)
        try:
            body = await read_body(request, BODY_MAX)
            wanted = msgspec.json.decode(body, type=ZonesRequest)
            edit = zone_edit(wanted)
        except (msgspec.DecodeError, DecodeError, ValueError) as error:
            return self._bad_request(error)
        self._on_command(edit)
        return Response(status_code=202)

    async def _follow_person(self, request: Request) -> Response:
        try:
            body = await read_body(request, REQUEST_MAX)
            wanted = msgspec.json.decode(body, type=FollowRequest)
        except (msgspec.DecodeError, ValueError) as error:
            return self._bad_request(error)
        command = TargetCommand(
            stamp_ns=time.time_ns(),
            sequence=0,
            action="none" if wanted.id is None else "id",
            id=wanted.id,
            chooser="dashboard",
        )
        self._on_command(command)
        return Response(status_code=202)

    def _bad_request(self, error: Exception) -> Response:
        self._hub.counters["bad_requests"] += 1
        return PlainTextResponse(f"{error}\n", 400)

    async def _stream(self, socket: WebSocket) -> None:
        """Serve a page or program until it leaves, stops reading or sends an invalid request."""
        await socket.accept()
        json = socket.url.path == "/people"
        if json and not self._hub.serves_json:
            await socket.close(REFUSED, "off: set dashboard.people_json = true")
            return
        if self._hub.viewers >= VIEWERS_MAX:
            self._hub.counters["viewers_refused"] += 1
            await socket.close(BUSY, "too many viewers")
            return
        viewer = Viewer(socket.scope["role"], json)
        self._hub.join(viewer)
        refusals: list[str] = []
        try:
            async with anyio.create_task_group() as group:

                async def run(work: Callable[[WebSocket, Viewer], Awaitable[str]]) -> None:
                    refusals.append(await work(socket, viewer))
                    group.cancel_scope.cancel()

                group.start_soon(run, self._send)
                group.start_soon(run, self._receive)
        finally:
            self._hub.leave(viewer)
        refusal = next(filter(None, refusals), "")
        if refusal and socket.client_state is WebSocketState.CONNECTED:
            await socket.close(REFUSED, refusal)

    async def _send(self, socket: WebSocket, viewer: Viewer) -> str:
        try:
            while True:
                packet = await viewer.next_packet()
                for kind, data in packet.parts:
                    if viewer.wants(kind):
                        with anyio.fail_after(STUCK_S):
                            if viewer.json:
                                await socket.send_text(data.decode())
                            else:
                                await socket.send_bytes(data)
        except TimeoutError:
            self._hub.counters["viewers_stuck"] += 1
            return ""
        except (WebSocketDisconnect, RuntimeError):  # the page has left
            return ""

    async def _receive(self, socket: WebSocket, viewer: Viewer) -> str:
        """Follow the requests of a page; return the reason of their end."""
        times: deque[float] = deque(maxlen=REQUESTS_MAX)
        while True:
            try:
                message = await socket.receive_bytes()
            except (WebSocketDisconnect, RuntimeError):
                return ""
            except KeyError:  # text message
                message = b""
            now_s = time.monotonic()
            if len(times) == REQUESTS_MAX and now_s - times[0] < 1:
                self._hub.counters["bad_requests"] += 1
                return "too many requests"
            times.append(now_s)
            try:
                self._follow(REQUESTS.decode(message), viewer)
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                self._hub.counters["bad_requests"] += 1
                return "no valid request"

    def _follow(self, request: PageRequest, viewer: Viewer) -> None:
        if request.type == "watch":
            viewer.images, viewer.cloud = request.images, request.cloud
        elif request.type != "seek":
            viewer.paused = request.type == "pause"
        elif viewer.paused:
            self._hub.seek(viewer, request.at_ms)
        self._hub.update_demand()


async def read_body(request: Request, most: int) -> bytes:
    """Return the body of a request.

    Raises:
        ValueError: The body is too large, or does not arrive in time.
    """
    body = bytearray()
    try:
        with anyio.fail_after(BODY_S):
            async for chunk in request.stream():
                body += chunk
                if len(body) > most:
                    raise ValueError(f"expected at most {most} bytes")
    except (ClientDisconnect, TimeoutError) as error:
        raise ValueError("the request broke off") from error
    return bytes(body)
