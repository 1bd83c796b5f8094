"""Command `people4d calibrate`."""

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from common.calibration.observations import ObservationCollector
from common.calibration.solve import CalibrationResult
from common.calibration.solve import calibrate as solve
from common.calibration.tags import TagObserver, move_to_map, read_tags
from common.calibration.transforms_file import check_tree, write_transforms
from common.io.images import decompress
from common.io.recording import open_recording
from deploy.calibration.page import floor_text, write_page
from deploy.cli.data.targets import Force, check_target
from deploy.cli.options import Connect, Robot, open_client
from deploy.cli.terminal import console, plain_table, shown
from people4d.client import Client
from people4d.errors import CalibrationError, ConfigError, DecodeError
from people4d.messages import (
    CameraInfo,
    CompressedRgbdFrame,
    Detections,
    Message,
    RgbdFrame,
    StaticTransform,
)
from people4d.queue import Arrival

EVERY_NS = 10_000_000_000  # period of the attempts [ns]
# Compressed frames show the floor; raw frames are received only for tags, since they are a high
# load.
KINDS: tuple[type[Message], ...] = (CameraInfo, StaticTransform, Detections, CompressedRgbdFrame)
RAW: tuple[type[Message], ...] = (RgbdFrame,)


def calibrate(
    recording: Annotated[
        Path | None,
        typer.Argument(help="Recording of detections; default: the running system, live."),
    ] = None,
    out: Annotated[
        Path, typer.Option(help="File of transforms, for people4d up --transforms.")
    ] = Path("transforms.toml"),
    page: Annotated[
        Path | None,
        typer.Option(help="Page with map and residuals; default: in the folder of --out."),
    ] = None,
    cameras: Annotated[
        str, typer.Option(help="Comma-separated names of the cameras; default: all.")
    ] = "",
    reference: Annotated[
        str, typer.Option(help="Camera that the others are relative to; default: the first.")
    ] = "",
    seconds: Annotated[
        float, typer.Option("--seconds", min=10, help="Maximum listening time [s].")
    ] = 180.0,
    tags: Annotated[
        Path | None,
        typer.Option(help="File of AprilTags at known positions, which define the map."),
    ] = None,
    offset_s: Annotated[
        float, typer.Option("--clocks", min=0.1, max=5, help="Maximum difference of clocks [s].")
    ] = 1.0,
    force: Force = False,
    hosts: Annotated[
        str,
        typer.Option(
            help="Comma-separated robot names of the cameras' hosts. --connect has one router for "
            "all, or their routers in the same order. Default: the host named by --robot."
        ),
    ] = "",
    robot: Robot = "robot",
    connect: Connect = "",
) -> None:
    """Find poses and clocks of several cameras from walking people in view.

    The file is written once the poses are certain; otherwise the reason is printed.
    """
    page = page or out.with_suffix(".html")
    check_target(out, None, force)
    check_target(page, None, force)
    observer = TagObserver(read_tags(tags)) if tags else None
    session = CalibrationSession(_names(cameras), reference, offset_s, observer)
    kinds = KINDS + (RAW if tags else ())
    if recording:
        for log_ns, message in open_recording(recording).messages(*kinds):
            session.add_message(message, log_ns)
        found = session.solve()
    else:
        console.print("Walk about in curves, one or two people; Ctrl-C ends the walk.")
        with ExitStack() as stack:
            opened = _clients(_listed(hosts), connect) if hosts else [open_client(connect, robot)]
            clients = [stack.enter_context(client) for client in opened]
            found = listen(session, _arrivals(clients, kinds, seconds), seconds)
    write_transforms(out, found)
    write_page(page, found)
    _show(found)
    typer.echo(f"Wrote {out} and {page}. Use it: people4d up --transforms {out}")


def _clients(hosts: Sequence[str], connect: str) -> Iterator[Client]:
    """Yield a client of each host."""
    endpoints = _listed(connect) or [""]
    if len(endpoints) not in (1, len(hosts)):
        raise ConfigError(
            f"--connect: expected one router, or {len(hosts)}, one of each host, "
            f"got {len(endpoints)}"
        )
    endpoints *= len(hosts) // len(endpoints)
    yield from map(open_client, endpoints, hosts)


def _arrivals(
    clients: Sequence[Client], kinds: Sequence[type[Message]], seconds: float
) -> Iterator[Arrival]:
    """Return the messages of all clients in one stream, until these are closed."""
    first, *others = clients
    for other in others:
        other.queue = first.queue
        other.arrivals(*kinds)
    return first.arrivals(*kinds, timeout_s=seconds)


class CalibrationSession:
    """Received observations, and the calibration from them."""

    def __init__(
        self, cameras: set[str], reference: str, offset_s: float, tags: TagObserver | None = None
    ) -> None:
        self._cameras, self._reference, self._offset_s = cameras, reference, offset_s
        self._tags = tags
        self._collector = ObservationCollector()
        self._transforms: dict[str, StaticTransform] = {}

    def copy(self) -> "CalibrationSession":
        """Return a copy, unaffected by later messages."""
        tags = self._tags.copy() if self._tags else None
        other = CalibrationSession(self._cameras, self._reference, self._offset_s, tags)
        other._collector = self._collector.copy()
        other._transforms = dict(self._transforms)
        return other

    def add_message(self, message: Message, arrived_ns: int) -> None:
        """Add a message; messages of other cameras are ignored."""
        if isinstance(message, StaticTransform):
            self._transforms[message.child] = message
        elif isinstance(message, CameraInfo | Detections) and (
            not self._cameras or message.camera in self._cameras
        ):
            self._collector.add_message(message, arrived_ns)
        elif isinstance(message, RgbdFrame | CompressedRgbdFrame):
            with suppress(DecodeError):  # bad image: the next one may be usable
                self._add_frame(message)

    def _add_frame(self, message: RgbdFrame | CompressedRgbdFrame) -> None:
        at = message.camera, message.stamp_ns
        for_floor = self._collector.wants_depth(*at)
        for_tags = self._tags is not None and self._tags.wants(*at)
        if not (for_floor or for_tags):
            return
        frame = message if isinstance(message, RgbdFrame) else decompress(message)
        if for_floor:
            self._collector.add_depth(*at, frame.depth_mm)
        if self._tags and for_tags:
            self._tags.add_image(*at, frame.rgb)

    def solve(self) -> CalibrationResult:
        """Return the calibration; CalibrationError if the observations are insufficient."""
        observed = self._collector.cameras
        absent = self._cameras - {camera.camera for camera in observed}
        if absent:
            raise CalibrationError(
                f"{', '.join(sorted(absent))} sends no detections", "Start it, or leave it out."
            )
        check_tree(list(self._transforms.values()), {c.camera: c.frame_id for c in observed})
        found = solve(observed, self._reference, search_s=self._offset_s)
        if self._tags is None:
            return found
        infos = {camera.camera: camera.info for camera in observed if camera.info}
        return move_to_map(found, self._tags.poses(infos))

    def summary(self) -> str:
        """Return the number of people in each camera, and a map of their positions in the image."""
        lines = ["people in frames, and where in view (left to right; far, middle, near):"]
        for c in self._collector.cameras:
            rows = ["".join("#" if cell else "." for cell in row) for row in c.coverage()]
            lines.append(f"{c.camera} {c.people} of {len(c.frames)}  {' '.join(rows)}")
        return "\n    ".join(lines) if len(lines) > 1 else "no camera yet"


def listen(
    session: CalibrationSession, arrivals: Iterable[Arrival], seconds: float
) -> CalibrationResult:
    """Return a calibration as soon as it is certain, by attempts while messages arrive.

    CalibrationError if the observations are not sufficient at the end.

    Args:
        session: Session of the messages.
        arrivals: Messages in order, ended by Ctrl-C.
        seconds: Maximum duration by their clock.
    """
    start_ns = last_ns = 0
    attempt: Future[CalibrationResult] | None = None
    with ThreadPoolExecutor(1) as pool, suppress(KeyboardInterrupt):
        for arrival in arrivals:
            session.add_message(arrival.message, arrival.received_ns)
            now_ns = arrival.received_ns
            start_ns, last_ns = start_ns or now_ns, last_ns or now_ns
            if now_ns - start_ns > seconds * 1e9:
                break
            if attempt and attempt.done():
                error = attempt.exception()
                if error is None:
                    return attempt.result()
                if not isinstance(error, CalibrationError):
                    raise error
                console.print(shown(f"  {error}"))
                attempt = None
            if attempt is None and now_ns - last_ns > EVERY_NS:
                last_ns = now_ns
                console.print(shown(f"{(now_ns - start_ns) / 1e9:.0f} s: {session.summary()}"))
                attempt = pool.submit(session.copy().solve)
    return session.solve()


def _show(found: CalibrationResult) -> None:
    table = plain_table(
        *("camera", ">x m", ">y m", ">z m", ">yaw deg", ">± cm", ">± deg", ">clock ms", ">± ms")
    )
    for name, matrix in sorted(found.map_from_camera.items()):
        pose = found.poses[name]
        yaw = np.degrees(np.arctan2(matrix[1, 2], matrix[0, 2]))
        table.add_row(
            shown(name),
            *(f"{v:.3f}" for v in matrix[:3, 3]),
            f"{yaw:.1f}",
            f"{100 * pose.sigma_m:.1f}",
            f"{np.degrees(pose.sigma_rad):.2f}",
            f"{1e3 * pose.offset_s:.1f}",
            f"{1e3 * pose.sigma_s:.1f}",
        )
    console.print(table)
    console.print(
        f"One person's positions by two cameras differ by {100 * found.adjustment.rms_m:.1f} cm "
        f"(RMS). Positions are relative to {shown(found.reference)}."
    )
    for a, b in found.contradicting:
        console.print(f"[yellow]{shown(a)} and {shown(b)} contradict the others: excluded[/]")
    odd = ", ".join(found.adjustment.odd_floors)
    if odd:
        console.print(
            f"[yellow]The floor before {shown(odd)} differs from the floor of the others: "
            "excluded[/]"
        )
    console.print(shown(floor_text(found)))


def _names(text: str) -> set[str]:
    names = set(_listed(text))
    if len(names) == 1:
        raise ConfigError(f"--cameras: expected two names or more, got {text}")
    return names


def _listed(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]
