"""Watches the pipeline, shows each frame as it comes, and the whole at the end."""

from collections.abc import Sequence
from typing import ClassVar

from common.drawing.people import CameraView, annotate
from common.drawing.tiles import Tile, shrink
from common.geometry.transforms import invert
from common.runtime.node import Node, Status
from people4d.messages import (
    CameraInfo,
    Detections,
    Health,
    Message,
    RgbdFrame,
    StaticTransform,
    Tracks,
    Truth,
)
from services.report.config import ReportConfig
from services.report.join import Join, Moment
from services.report.output import Output, Picture
from services.report.sheet import contact_sheet
from services.report.spread import EvenSample
from services.report.statistics import Statistics
from services.report.trails import Trails


class ReportNode(Node):
    """Joins frames with what was made of them; memory is bounded however long the run.

    Args:
        config: The configuration.
        output: Where pictures and the summary go.
    """

    inputs: ClassVar[tuple[type[Message], ...]] = (
        RgbdFrame,
        Detections,
        Tracks,
        Truth,
        CameraInfo,
        StaticTransform,
        Health,
    )

    def __init__(self, config: ReportConfig, output: Output) -> None:
        self._config = config
        self._output = output
        self._join = Join()
        self._statistics = Statistics()
        self._trails = Trails()
        self._infos: dict[str, CameraInfo] = {}
        self._tiles: EvenSample[Tile] = EvenSample(2 * config.sheet_frames)
        self._first_ns: int | None = None

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Take a message; the report publishes nothing."""
        self._statistics.add(message, now_ns)
        if isinstance(message, CameraInfo):
            self._infos[message.camera] = message
        if isinstance(message, Tracks | Truth | StaticTransform):
            self._trails.add(message)
        if isinstance(message, RgbdFrame | Detections | Tracks):
            for moment in self._join.add(message):
                self._show(moment)
        return ()

    def status(self) -> Status:
        """Return what the heartbeat shall say."""
        return Status(counters={"pictures": self._tiles.count})

    def close(self) -> None:
        """Finish the report."""
        for moment in self._join.flush():
            self._show(moment)
        summary = self._statistics.summary()
        tiles = self._tiles.pick(self._config.sheet_frames)
        self._output.finish(contact_sheet(tiles, self._trails.walks(), summary), summary)

    def _show(self, moment: Moment) -> None:
        """Draw a frame if the video or the contact sheet wants it."""
        self._statistics.settle(moment)
        if moment.rgb is None or (moment.detections is None and moment.tracks is None):
            return
        if not self._config.video and not self._tiles.wants_next:
            self._tiles.skip()
            return
        image = annotate(moment.rgb, moment.detections, moment.tracks, self._view(moment.camera))
        if self._config.video:
            self._output.picture(Picture(moment.camera, moment.stamp_ns, image))
        if self._tiles.wants_next:
            self._tiles.add(Tile(shrink(image, self._config.tile_width_px), self._caption(moment)))
        else:
            self._tiles.skip()

    def _view(self, camera: str) -> CameraView | None:
        info = self._infos.get(camera)
        pose = self._trails.map_from_optical(info.frame_id) if info else None
        return CameraView(info, invert(pose)) if info and pose is not None else None

    def _caption(self, moment: Moment) -> str:
        if self._first_ns is None:
            self._first_ns = moment.stamp_ns
        return f"{moment.camera}  {(moment.stamp_ns - self._first_ns) / 1e9:.2f} s"
