"""From a recording to its tables, plots and pictures."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import msgspec

from common.config import load
from common.drawing.tiles import Tile, grid
from evaluation.gait.following import Box, LaunchRequest, follow
from evaluation.gait.log import Log
from evaluation.gait.viewer import Viewer
from evaluation.methods import read_method
from evaluation.report.csv_files import write_bytes
from lab import scenario as scenarios
from lab.scenario import load_scenario, split_seed
from people4d.errors import SourceError
from people4d.messages import U8, CameraInfo
from services.camera.describe import describe
from services.camera.sources import kind_of
from services.gait.config import GaitConfig
from services.gait.people import Found, Scene
from services.presets import preset_settings
from services.report.even_sample import EvenSample
from services.report.folder import VideoFile
from services.report.output import AnnotatedFrame

SERVICE = "gait."
STILLS, COLUMNS = 6, 2

Told = Callable[[str, float], None]


def read_wish(
    source: str,
    box: Box | None,
    preset: str,
    settings: Sequence[str],
) -> LaunchRequest:
    """Return what is to be done.

    Args:
        source: Recording, bag, folder or lab:SCENARIO.
        box: Of the person; None: everybody.
        preset: Name of a preset, or a TOML file; empty: as configured.
        settings: "service.field=value", which win over the preset.

    Raises:
        ConfigError: A preset or setting is unknown, or a value is out of range.
    """
    told = [*preset_settings(preset), *settings]
    own = [text.removeprefix(SERVICE) for text in told if text.startswith(SERVICE)]
    method = read_method("", [text for text in told if not text.startswith(SERVICE)])
    gait = load(GaitConfig, "gait", None, own)
    return LaunchRequest(source=source, method=method, gait=gait, box=box)


class Report:
    """Follows people and writes down what was found.

    Args:
        request: What is followed.
        folder: Of the files.
        video: Whether each frame is drawn.
        figures: Whether plots are drawn, which takes matplotlib.
    """

    def __init__(self, request: LaunchRequest, folder: Path, video: bool, figures: bool) -> None:
        cascade = msgspec.structs.replace(request.gait.cascade, keep_details=True)
        self._wish = replace(request, gait=msgspec.structs.replace(request.gait, cascade=cascade))
        self._folder, self._figures = folder, figures
        self._draws_all = video
        self._video: VideoFile | None = None
        self._stills: EvenSample[Tile] = EvenSample(2 * STILLS)
        self._viewer: Viewer | None = None
        self.log = Log(request.gait.steps)

    def run(self, told: Told) -> None:
        """Go through the recording, telling the share of it that is done.

        Raises:
            SourceError: The recording cannot be played, or the folder cannot be written.
            ModelError: A model is absent.
        """
        make_folder(self._folder)
        frames = frame_count(self._wish)
        told(self._wish.source, 0.0)
        for done, _ in enumerate(follow(self._wish, self._watch), 1):
            told(self._wish.source, min(done / frames, 1.0))
        told(self._wish.source, 1.0)

    def finish(self) -> None:
        """Write tables and pictures of what came.

        Raises:
            SourceError: A file cannot be written.
        """
        if self._video:
            self._video.close()
        self.log.write(self._folder)
        if not self.log.people:
            return
        sheet = grid(self._stills.pick(STILLS), COLUMNS)
        _, png = cv2.imencode(".png", cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))
        write_bytes(self._folder / "frames.png", png.tobytes())
        if self._figures:
            self._draw()

    def _draw(self) -> None:
        from evaluation.gait import figures  # noqa: PLC0415 (matplotlib is an extra)

        for person in self.log.people:
            write_bytes(self._folder / f"paths_{person}.png", figures.paths(self.log, person))
            write_bytes(self._folder / f"steps_{person}.png", figures.steps(self.log, person))

    def _watch(self, info: CameraInfo, scene: Scene, found: Sequence[Found]) -> None:
        time_s = self.log.add(scene.stamp_ns, found)
        self._viewer = self._viewer or Viewer(info, self._wish.gait.cascade.depth.spin)
        self._viewer.see(scene, found)
        # A frame without anybody shows nothing of what this is about.
        wanted = bool(found) and self._stills.takes_next
        if self._draws_all or wanted:
            image = self._viewer.draw(scene, found)
            self._record(info.camera, scene.stamp_ns, image)
            if wanted:
                self._stills.add(Tile(image, f"{time_s:.2f} s"))
        if found and not wanted:
            self._stills.skip()

    def _record(self, camera: str, stamp_ns: int, image: U8) -> None:
        if self._draws_all:
            self._video = self._video or VideoFile(self._folder / "gait.webm")
            self._video.write(AnnotatedFrame(camera, stamp_ns, image))


def make_folder(folder: Path) -> None:
    """Make a folder, before anything that takes long.

    Raises:
        SourceError: It cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SourceError(f"folder {folder} cannot be made: {error.strerror}") from error


def frame_count(request: LaunchRequest) -> int:
    """Return about how many frames will be played; at least 1.

    Raises:
        SourceError: The source is of no kind that is known.
    """
    camera = request.method.camera
    if scenarios.is_scenario(request.source):
        scenario = load_scenario(split_seed(request.source.removeprefix(scenarios.PREFIX))[0])
        frames = round(scenario.duration_s * scenario.camera.fps)
    elif kind_of(request.source) == "plugin":
        frames = camera.max_frames
    else:
        frames = describe(Path(request.source)).frames
    frames = -(-frames // camera.stride)
    return max(min(frames, camera.max_frames or frames), 1)
