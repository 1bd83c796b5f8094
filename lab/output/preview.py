"""Images of a scenario with its truth, for a preview."""

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

from common.drawing.people import CameraView, annotate
from common.drawing.strokes import PAPER, put_label
from common.drawing.tiles import Tile, grid, shrink
from common.drawing.topdown import Trajectories, draw_map
from common.drawing.video import VideoWriter
from lab.camera.frames import FrameRenderer, flat
from lab.truth.frames import PersonView, person_views
from lab.world import World
from people4d.errors import SourceError
from people4d.messages import U8, U16, Detection, Detections, Track, Tracks

COLUMNS = 3
TILES = 9  # default number of tiles of a sheet
TILE_PX = 640  # width of a tile [px]
PATH_STEP_S = 0.1  # interval of the points of a path on the map [s]
UNKNOWN = np.zeros((6, 6))  # covariance, not shown in images


class Preview:
    """Draws rendered frames with their depth, masks and a map."""

    def __init__(self, renderer: FrameRenderer) -> None:
        self._renderer = renderer
        self._world = world = renderer.world
        times_s = np.arange(0, world.scenario.duration_s + PATH_STEP_S, PATH_STEP_S)
        self._person_paths = [
            np.array([motion.at(t_s).map_from_pelvis[:2, 3] for t_s in times_s])
            for motion in world.motions
        ]
        # The path of the camera makes the scale of the map constant.
        self._camera_path = np.array([world.map_from_optical(t_s)[:2, 3] for t_s in times_s])

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of an image in pixels."""
        return 2 * self._world.info.width, 2 * self._world.info.height

    def time_s(self, index: int) -> float:
        """Return the time of a frame."""
        return self._world.frame_s(index)

    def frames(self, every_s: float | None = None) -> range:
        """Return frames at an interval; None: all."""
        step = max(1, round((every_s or 0.0) * self._world.scenario.camera.fps))
        return range(0, self._world.frame_count, step)

    def few_frames(self, every_s: float | None = None) -> Sequence[int]:
        """Return frames at an interval; None: the number that fills a page."""
        if every_s:
            return self.frames(every_s)
        last = self._world.frame_count - 1
        return sorted({round(last * (k + 1) / (TILES + 1)) for k in range(TILES)})

    def image(self, index: int) -> U8:
        """Return a frame: colour with people, depth, masks and a map, two by two."""
        world, renderer = self._world, self._renderer
        t_s, info = world.frame_s(index), world.info
        view = renderer.view(index)
        people = person_views(world, t_s, view)
        visible = CameraView(info, world.optical_from_map(t_s))
        colour = annotate(renderer.rgb(index, view), *_messages(world, index, people), visible)
        depth = depth_image(renderer.depth_mm(index, view), info.max_depth_m)
        walks = Trajectories(
            tracks={
                k + 1: path[: 1 + round(t_s / PATH_STEP_S)]
                for k, path in enumerate(self._person_paths)
            },
            truth={str(k): path for k, path in enumerate([*self._person_paths, self._camera_path])},
            cameras=[world.map_from_optical(t_s)],
        )
        panels = [colour, depth, flat(view), draw_map(walks, info.width, info.height)]
        for panel, name in zip(panels, ("truth", "depth", "masks", ""), strict=True):
            if name:
                put_label(panel, name, (0, info.height), info.width / 49, PAPER)
        return np.vstack([np.hstack(panels[:2]), np.hstack(panels[2:])])


def depth_image(depth_mm: U16, most_m: float) -> U8:
    """Return depth in colours from near (red) to far (blue), black without reading."""
    share = np.clip(depth_mm / (1000 * most_m), 0, 1)
    bgr = cv2.applyColorMap((255 * (1 - share)).astype(np.uint8), cv2.COLORMAP_TURBO)
    bgr[depth_mm == 0] = 0
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)


def write_sheet(
    preview: Preview, frames: Sequence[int], path: Path, progress: Callable[[float], object]
) -> None:
    """Write a PNG of some frames.

    SourceError if the file cannot be written.

    Args:
        preview: Preview of the scenario.
        frames: Numbers of the frames.
        path: Output file.
        progress: Called with the finished share, 0 to 1.
    """
    tiles = []
    for done, index in enumerate(frames, 1):
        caption = f"{preview.time_s(index):.1f} s"
        tiles.append(Tile(shrink(preview.image(index), TILE_PX), caption))
        progress(done / len(frames))
    _, data = cv2.imencode(".png", cv2.cvtColor(grid(tiles, COLUMNS), cv2.COLOR_RGB2BGR))
    try:
        path.write_bytes(data.tobytes())
    except OSError as error:
        raise SourceError(f"image {path} cannot be written: {error.strerror}") from error


def write_video(
    preview: Preview, frames: Sequence[int], path: Path, progress: Callable[[float], object]
) -> None:
    """Write a video of evenly spaced frames; see `write_sheet`."""
    rate_hz = 1 / (preview.time_s(frames[1]) - preview.time_s(frames[0])) if len(frames) > 1 else 1
    width, height = preview.size
    writer = VideoWriter(path, rate_hz, (width, height))
    for done, index in enumerate(frames, 1):
        writer.write(preview.image(index))
        progress(done / len(frames))
    writer.close()


def _messages(world: World, index: int, people: Sequence[PersonView]) -> tuple[Detections, Tracks]:
    info, stamp_ns = world.info, world.stamp_ns(index)
    visible = [k for k, person in enumerate(people) if person.visible_share > 0]
    detections = Detections(
        stamp_ns=stamp_ns,
        sequence=index,
        camera=info.camera,
        frame_id=info.frame_id,
        model="truth",
        width=info.width,
        height=info.height,
        detections=tuple(_detection(people[k]) for k in visible),
    )
    tracks = Tracks(
        stamp_ns=stamp_ns,
        sequence=index,
        frame_id="map",
        tracker="truth",
        camera=info.camera,
        tracks=tuple(
            _track(k + 1, person, visible.index(k) if k in visible else None)
            for k, person in enumerate(people)
        ),
    )
    return detections, tracks


def _detection(person: PersonView) -> Detection:
    points = np.column_stack([np.nan_to_num(person.keypoints_px), person.visible])
    return Detection(
        box_xyxy_px=person.box_xyxy_px.astype(np.float32),
        score=1.0,
        keypoints=points.astype(np.float32),
    )


def _track(number: int, person: PersonView, detection: int | None) -> Track:
    return Track(
        id=number,
        state="confirmed",
        position_m=person.position_m,
        velocity_mps=person.velocity_mps,
        covariance=UNKNOWN,
        yaw_rad=person.yaw_rad,
        hits=1,
        age=1,
        time_since_update_s=0.0,
        detection=detection,
        score=1.0,
    )
