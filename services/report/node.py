"""Annotates each frame of a running pipeline, and writes a report at the end."""

from collections.abc import Sequence

from common.drawing.people import CameraView, annotate
from common.drawing.tiles import Tile, grid, shrink
from common.geometry.transforms import invert
from common.io.images import encode_jpeg
from common.runtime.node import Node, Status
from common.runtime.synchroniser import SynchronisedFrame, Synchroniser
from people4d.messages import (
    CameraInfo,
    Detections,
    Health,
    Message,
    MovingTransform,
    Odometry,
    RgbdFrame,
    StaticTransform,
    Tracks,
    Truth,
)
from people4d.messages.base import MAX_CAMERAS
from services.report.config import ReportConfig
from services.report.even_sample import EvenSample
from services.report.folder import AnnotatedFrame, ReportOutput
from services.report.page import RunPage
from services.report.sheet import COLUMNS, contact_sheet
from services.report.statistics import RunStatistics
from services.report.trajectories import TrajectoryStore

TILE_WIDTH_PX = 480  # width of a frame on the sheet [px]


class ReportNode(Node):
    """Joins frames with their detections and tracks, in bounded memory."""

    inputs: tuple[type[Message], ...] = (
        RgbdFrame,
        Detections,
        Tracks,
        Truth,
        CameraInfo,
        StaticTransform,
        MovingTransform,
        Odometry,
        Health,
    )
    frames_waiting = 16  # long queue: on a busy machine the report lags without losing frames

    def __init__(self, config: ReportConfig, output: ReportOutput) -> None:
        self._config = config
        self._output = output
        self._join = Synchroniser()
        self._statistics = RunStatistics(config.truth)
        self._trajectories = TrajectoryStore()
        self._infos: dict[str, CameraInfo] = {}
        self._tiles: EvenSample[Tile] = EvenSample(2 * config.sheet_frames)
        self._first_ns: int | None = None

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Add a message; the report publishes nothing."""
        self._statistics.add_message(message, now_ns)
        if isinstance(message, CameraInfo):
            known = message.camera in self._infos
            if known or len(self._infos) < MAX_CAMERAS:
                self._infos[message.camera] = message
        if isinstance(message, Tracks | Truth | StaticTransform):
            self._trajectories.add_message(message)
        if isinstance(message, RgbdFrame | Detections | Tracks):
            for frame in self._join.add_message(message):
                self._show(frame)
        return ()

    def status(self) -> Status:
        """Return state, reason and counters for the heartbeat."""
        return Status(counters={"frames": self._tiles.count})

    def close(self) -> None:
        """Finish the report."""
        for frame in self._join.flush():
            self._show(frame)
        summary = self._statistics.summary()
        tiles = self._tiles.pick(self._config.sheet_frames)
        trajectories = self._trajectories.trajectories()
        page = RunPage(
            summary=summary,
            trajectories=trajectories,
            series=self._statistics.series,
            note=self._config.note,
            sheet_jpeg=encode_jpeg(grid(tiles, COLUMNS)) if tiles else b"",
        )
        self._output.finish(contact_sheet(tiles, trajectories, summary), page)

    def _show(self, frame: SynchronisedFrame) -> None:
        """Draw a frame for the video and the contact sheet."""
        self._statistics.settle(frame)
        if frame.image is None or (frame.detections is None and frame.tracks is None):
            return
        if not self._config.video and not self._tiles.is_next:
            self._tiles.skip()
            return
        image = annotate(frame.image.rgb, frame.detections, frame.tracks, self._view(frame.camera))
        if self._config.video:
            self._output.add_frame(AnnotatedFrame(frame.camera, frame.stamp_ns, image))
        if self._tiles.is_next:
            self._tiles.add_value(Tile(shrink(image, TILE_WIDTH_PX), self._caption(frame)))
        else:
            self._tiles.skip()

    def _view(self, camera: str) -> CameraView | None:
        info = self._infos.get(camera)
        pose = self._trajectories.map_from_optical(info.frame_id) if info else None
        return CameraView(info, invert(pose)) if info and pose is not None else None

    def _caption(self, frame: SynchronisedFrame) -> str:
        if self._first_ns is None:
            self._first_ns = frame.stamp_ns
        return f"{frame.camera}  {(frame.stamp_ns - self._first_ns) / 1e9:.2f} s"
