"""Web application of the annotation page, served by the dashboard's web server."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from evaluation.annotations.images import AnnotatedImages
from evaluation.annotations.marks import (
    Mark,
    MarkedImage,
    check_recording,
    read_annotations,
    write_marks,
)
from people4d.errors import SourceError
from services.dashboard.access import Guard, allowed_hosts
from services.dashboard.address import Tokens
from services.dashboard.config import DashboardConfig
from services.dashboard.web import BODY_MAX, PAGE, read_body

OWN_PAGE = Path(__file__).with_name("page")


class MarksRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Request of a page to replace the marks of an image."""

    base: tuple[Mark, ...] | None  # marks that the page has replaced; None: not annotated
    people: tuple[Mark, ...]


class AnnotationApp:
    """Serves the images, and stores marks in the file at once.

    The file is read for each request, so that two pages or programs see each other's marks.
    SourceError if the file is no file of annotations, or annotates another recording.
    """

    def __init__(self, name: str, images: AnnotatedImages, path: Path) -> None:
        self._name, self._images, self._path = name, images, path
        self._marks()

    def guarded(self, config: DashboardConfig, tokens: Tokens) -> Guard:
        """Return the application behind the checks of the dashboard."""
        files = StaticFiles(directory=OWN_PAGE, html=True)
        files.all_directories.append(PAGE)
        routes = [
            Route("/frames", self._list),
            Route("/frames/{frame:int}", self._get),
            Route("/frames/{frame:int}", self._put, methods=["PUT"]),
            Route("/frames/{frame:int}/image", self._image),
            Mount("/", files),
        ]
        handlers = {SourceError: _refuse}  # the file was changed by another program
        app = Starlette(routes=routes, exception_handlers=handlers)
        return Guard(app, tokens, allowed_hosts(config))

    async def _list(self, _: Request) -> Response:
        """List the images, those with marks, and all people."""
        marks = self._marks()
        people = dict.fromkeys(mark.person for image in marks.values() for mark in image)
        about = {
            "recording": self._name,
            "file": str(self._path),
            "frames": list(self._images.images),
            "annotated": [frame for frame in self._images.images if frame in marks],
            "people": list(people),
            "width": self._images.info.width,
            "height": self._images.info.height,
            "unreadable": self._images.unreadable,
        }
        return _json(about)

    async def _get(self, request: Request) -> Response:
        frame = request.path_params["frame"]
        if frame not in self._images.images:
            return PlainTextResponse(f"Frame {frame} is not annotated here.\n", 404)
        return self._answer(frame)

    async def _image(self, request: Request) -> Response:
        image = self._images.images.get(request.path_params["frame"])
        if image is None:
            return PlainTextResponse("There is no such frame.\n", 404)
        return Response(image.rgb_jpeg, media_type="image/jpeg")

    async def _put(self, request: Request) -> Response:
        frame, info = request.path_params["frame"], self._images.info
        if frame not in self._images.images:
            return PlainTextResponse(f"Frame {frame} is not annotated here.\n", 404)
        try:
            body = await read_body(request, BODY_MAX)
            wanted = msgspec.json.decode(body, type=MarksRequest)
            image = MarkedImage(frame, wanted.people)
            for mark in wanted.people:
                if not (0 <= mark.u_px < info.width and 0 <= mark.v_px < info.height):
                    raise ValueError(f"{mark.person}: the point is outside the image")
            if self._marks().get(frame) != wanted.base:
                text = "Another page changed this frame; its marks are shown. Repeat your change.\n"
                return PlainTextResponse(text, 409)
            write_marks(self._path, image, self._images.digest)
        except (ValueError, SourceError) as error:  # DecodeErrors are ValueErrors
            return PlainTextResponse(f"{error}\n", 400)
        return self._answer(frame)

    def _answer(self, frame: int) -> Response:
        marks = self._marks().get(frame)
        points_m = self._images.points_m(frame, marks or (), np.eye(4))
        distances_m = [None if p is None else float(np.linalg.norm(p)) for p in points_m]
        people = None if marks is None else [msgspec.to_builtins(mark) for mark in marks]
        return _json({"people": people, "distances_m": distances_m})

    def _marks(self) -> dict[int, tuple[Mark, ...]]:
        if not self._path.exists():
            return {}
        annotations = read_annotations(self._path)
        check_recording(self._path, annotations, self._images.digest)
        return {image.frame: image.people for image in annotations.marks}


async def _refuse(_: Request, error: Exception) -> Response:
    return PlainTextResponse(f"{error}\n", 400)


def _json(value: Any) -> Response:
    return Response(msgspec.json.encode(value), media_type="application/json")
