"""Report of the gait in a recording: tables, pages and images."""

import math
from collections.abc import Sequence
from dataclasses import astuple, fields
from pathlib import Path

import cv2

from common.config import load
from common.drawing.tiles import Tile, grid
from common.drawing.topdown import Trajectories
from evaluation.gait.parameters import GaitParameter, gait_parameters
from evaluation.gait.person_page import person_page
from evaluation.gait.run import BoxCorners, GaitRun, estimate_gait
from evaluation.gait.tables import GaitTables
from evaluation.gait.viewer import GaitViewer
from evaluation.methods import read_method
from evaluation.pool import OnProgress
from evaluation.report.csv_files import write_bytes, write_csv
from lab import catalogue as scenarios
from lab.catalogue import load_scenario, split_seed
from people4d.errors import SourceError
from people4d.messages import U8, CameraInfo
from services.camera.describe import describe
from services.camera.sources import kind_of
from services.gait.config import POINTS_MODEL, GaitConfig
from services.gait.estimator import GaitFrame, GaitResult
from services.gait.points.keypoints import HEAD
from services.presets import preset_settings
from services.report.even_sample import EvenSample
from services.report.folder import AnnotatedFrame, VideoFile

SERVICE = "gait."
STILLS, COLUMNS = 6, 2


def read_run(source: str, box: BoxCorners | None, preset: str, settings: Sequence[str]) -> GaitRun:
    """Return a run with the configuration of a preset and the settings that override it.

    Keypoints are of POINTS_MODEL unless a setting names another model.

    Raises:
        ConfigError: A preset or setting is unknown, or a value is out of range.
    """
    texts = [f"detector.model={POINTS_MODEL}", *preset_settings(preset), *settings]
    own = [text.removeprefix(SERVICE) for text in texts if text.startswith(SERVICE)]
    method = read_method("", [text for text in texts if not text.startswith(SERVICE)])
    gait = load(GaitConfig, "gait", None, own)
    return GaitRun(source=source, method=method, gait=gait, box=box)


class GaitReport:
    """Runs gait estimation and writes its results to a folder.

    A `video` draws every frame.
    """

    def __init__(self, run: GaitRun, folder: Path, video: bool) -> None:
        self._run, self._folder, self._draws_all = run, folder, video
        self._video: VideoFile | None = None
        self._stills: EvenSample[Tile] = EvenSample(2 * STILLS)
        self._viewer: GaitViewer | None = None
        self.tables = GaitTables()

    def run(self, on_progress: OnProgress) -> None:
        """Play the recording.

        Raises:
            SourceError: The recording cannot be played, or the folder cannot be written.
            ModelError: A model is absent.
        """
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SourceError(f"folder {self._folder} cannot be made: {error.strerror}") from error
        source, frames = self._run.source, frame_count(self._run)
        on_progress(source, 0.0)
        for done, _ in enumerate(estimate_gait(self._run, self._add, self.tables.add_skeletons), 1):
            on_progress(source, min(done / frames, 1.0))
        on_progress(source, 1.0)

    def finish(self) -> None:
        """Write tables and images of the frames so far.

        Raises:
            SourceError: A file cannot be written.
        """
        if self._video:
            self._video.encode(math.inf)
        self.tables.write(self._folder)
        if not self.tables.people:
            return
        self._write_people()
        sheet = grid(self._stills.pick(STILLS), COLUMNS)
        _, png = cv2.imencode(".png", cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))
        write_bytes(self._folder / "frames.png", png.tobytes())

    def _write_people(self) -> None:
        """Write parameters.csv, and the page of each person."""
        rows: list[Sequence[object]] = []
        for person in self.tables.people:
            steps = self.tables.steps(person)
            head = self.tables.trajectories(person).get(HEAD)
            tracks = {} if head is None else {person: head.points_m[:, :2]}
            parameters = gait_parameters(steps)
            rows += [(person, *astuple(one)) for one in parameters]
            page = person_page(person, parameters, steps, Trajectories(tracks=tracks))
            write_bytes(self._folder / f"person_{person}.html", page.encode())
        header = ("person", *(one.name for one in fields(GaitParameter)))
        write_csv(self._folder / "parameters.csv", header, rows)

    def _add(self, info: CameraInfo, frame: GaitFrame, results: Sequence[GaitResult]) -> None:
        time_s = self.tables.add_frame(frame.stamp_ns, results)
        self._viewer = self._viewer or GaitViewer(info)
        self._viewer.add_frame(frame, results)
        # Stills show frames with people only.
        wanted = bool(results) and self._stills.is_next
        if self._draws_all or wanted:
            image = self._viewer.draw(frame, results)
            self._record(info.camera, frame.stamp_ns, image)
            if wanted:
                self._stills.add_value(Tile(image, f"{time_s:.2f} s"))
        if results and not wanted:
            self._stills.skip()

    def _record(self, camera: str, stamp_ns: int, image: U8) -> None:
        if self._draws_all:
            self._video = self._video or VideoFile(self._folder / "gait.webm")
            self._video.add_frame(AnnotatedFrame(camera, stamp_ns, image), has_room=True)


def frame_count(run: GaitRun) -> int:
    """Return the approximate number of played frames, at least 1.

    Raises:
        SourceError: The source has an unsupported format.
    """
    camera = run.method.camera
    if scenarios.is_scenario(run.source):
        scenario = load_scenario(split_seed(run.source.removeprefix(scenarios.PREFIX))[0])
        frames = round(scenario.duration_s * scenario.camera.fps)
    elif kind_of(run.source) in ("camera", "plugin"):
        frames = camera.max_frames
    else:
        frames = describe(Path(run.source)).frames
    frames = -(-frames // camera.stride)
    return max(min(frames, camera.max_frames or frames), 1)
