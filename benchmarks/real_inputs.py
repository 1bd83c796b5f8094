"""The node chain on recordings of real people: what each model, embedder and tracker makes of them.

The recordings are not part of the repository; `--shared` names the folder that holds them. The
annotated pictures go to out/real_inputs/ and stay there, since they show real people.
"""

import argparse
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from benchmarks.lib.peers.published import published_tracker
from benchmarks.lib.table import markdown, write
from common.drawing.people import annotate
from common.drawing.tiles import shrink
from common.runtime.node import Node
from evaluation.methods import read_method
from evaluation.pipeline import PipelineStep, pipeline, play, track_again
from evaluation.recordings.hand_annotations import TORSO_MM, compare, crossing_camera, match
from people4d.messages import U8, Crops, Detection, Detections, Message, RgbdFrame, Tracks
from services.camera.config import CameraConfig
from services.detector.config import DetectorConfig
from services.reid.config import ReidConfig
from services.report.config import ReportConfig
from services.report.folder import AnnotatedFrame
from services.report.node import ReportNode
from services.report.page import RunPage
from services.tracker.config import TrackerConfig

ROOT = Path(__file__).parents[1]
OUT = ROOT / "out" / "real_inputs"
# By name in the table; the first is what ships.
TRACKERS = {
    "strongsort3d (ships)": TrackerConfig(),
    "strongsort3d [PIC4SeR]": published_tracker("strongsort3d"),
    "sort3d [PIC4SeR]": published_tracker("sort3d"),
    "image_sort (preset image-sort-best)": read_method("image-sort-best").tracker,
}
SHIPPED = next(iter(TRACKERS))
SHEET_FRAMES = 24


@dataclass
class Played:
    """Messages of a recording played through all nodes, without images."""

    messages: list[Message] = field(default_factory=list)

    @property
    def detections(self) -> list[Detections]:
        """Detections, a message a frame."""
        return [m for m in self.messages if isinstance(m, Detections)]

    @property
    def tracks(self) -> list[Tracks]:
        """Tracks, a message a frame."""
        return [m for m in self.messages if isinstance(m, Tracks)]


class Sheet:
    """Output of the report that keeps nothing but the contact sheet.

    Args:
        path: PNG that is written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def add_frame(self, frame: AnnotatedFrame) -> None:
        """Take a frame of the video; there is none."""

    def finish(self, sheet: U8, page: RunPage) -> None:  # noqa: ARG002
        """Write the sheet."""
        save(self._path, sheet)


def models(shared: Path) -> dict[str, str]:
    """Return the models by name, each as a name of the manifest or a path."""
    folder = shared / "data" / "models"
    exported = {n: str(folder / f"{n}_640.onnx") for n in ("yolov8n-pose", "yolov8n-seg")}
    return {"movenet-multipose": "movenet-multipose", **exported}


def osnet(shared: Path) -> ReidConfig:
    """Return the settings of the network for re-identification."""
    path = shared / "data" / "models" / "osnet_x0_25_msmt17.onnx"
    return ReidConfig(embedder="osnet", model=str(path))


def lockstep(source: Path) -> CameraConfig:
    """Return how a recording is played frame by frame."""
    return CameraConfig(source=str(source), playback="lockstep", window=1, start_delay_s=0.0)


def gather(
    steps: Iterable[PipelineStep], watch: Callable[[Message], object] = lambda _: None
) -> Played:
    """Play to the end.

    Args:
        steps: Frames as they are played.
        watch: Shown every message.
    """
    played = Played()
    for step in steps:
        for message in step.messages:
            watch(message)
            if not isinstance(message, RgbdFrame | Crops):
                played.messages.append(message)
    return played


def play_with_sheet(camera: CameraConfig, detector: str, reid: ReidConfig, path: Path) -> Played:
    """Play a recording through a model, and draw what comes of it."""
    report = ReportNode(ReportConfig(video=False, sheet_frames=SHEET_FRAMES), Sheet(path))
    steps = play(camera, pipeline(DetectorConfig(model=detector), reid))
    played = gather(steps, lambda message: report.handle(message, 0))
    report.close()
    return played


def crossing_rows(shared: Path) -> Iterator[list[str]]:
    """Play filinha with every model, and yield a row for each tracker."""
    runs = [(name, ReidConfig()) for name in models(shared)]
    for name, reid in [*runs, ("yolov8n-pose", osnet(shared))]:
        path = OUT / f"filinha_{name}_{reid.embedder}.png"
        played = play_with_sheet(crossing_camera(shared), models(shared)[name], reid, path)
        for tracker in TRACKERS if reid == ReidConfig() else (SHIPPED,):
            again = track_again(played.messages, TRACKERS[tracker])
            yield [name, reid.embedder, tracker, *_figures(played, again)]


def _figures(played: Played, tracks: list[Tracks]) -> list[str]:
    confirmed = [t.id for m in tracks for t in m.tracks if t.state == "confirmed"]
    lengths = list(Counter(confirmed).values()) or [0]
    people = [len(m.detections) for m in played.detections]
    with_position = sum(d.position_m is not None for m in played.detections for d in m.detections)
    scores = compare(played.detections, tracks)
    return [
        f"{np.mean(people):.2f} ({max(people)})",
        f"{with_position / max(sum(people), 1):.1%}",
        f"{scores.found} of {scores.people}",
        str(scores.false),
        str(len(set(confirmed))),
        f"{np.mean(lengths):.1f} / {np.median(lengths):.0f}",
        f"{scores.identified} of {scores.people}",
    ]


def man_in_front(
    bag: Path, nodes: Sequence[Node]
) -> tuple[Detection | None, U8, dict[tuple[int, int], int]]:
    """Find the man in front in a bag of one frame.

    Args:
        bag: One of the TUE bags.
        nodes: The detector and whatever follows it.

    Returns:
        The man, None if not found; the annotated picture; the depth [mm] at the pixels picked by
        hand on his torso.
    """
    pixels = list(TORSO_MM[bag.stem])
    steps = play(lockstep(bag), nodes)
    messages = [message for step in steps for message in step.messages]
    (frame,) = (m for m in messages if isinstance(m, RgbdFrame))
    (detections,) = (m for m in messages if isinstance(m, Detections))
    pairs = match(pixels[1:2], detections.detections)
    image = annotate(frame.rgb, detections, None, None)
    for pixel in pixels:
        cv2.drawMarker(image, pixel, (0, 255, 0), cv2.MARKER_CROSS, 12, 2)
    torso_mm = {(u, v): int(frame.depth_mm[v, u]) for u, v in pixels}
    return detections.detections[pairs[0][1]] if pairs else None, image, torso_mm


def bag_rows(shared: Path) -> Iterator[list[str]]:
    """Yield a row for each bag: depth read by hand, and forward distance by each model."""
    images = []
    for stem in TORSO_MM:
        bag = shared / "data" / "rgbd" / "tue" / f"{stem}.bag"
        cells, readings = [], ""
        for model in models(shared).values():
            # A tracker would wait for a second frame of so much later.
            nodes = pipeline(DetectorConfig(model=model))
            man, image, torso_mm = man_in_front(bag, nodes)
            readings = ", ".join(f"{mm / 1000:.2f} at {u},{v}" for (u, v), mm in torso_mm.items())
            by_hand_m = float(np.median(list(torso_mm.values()))) / 1000
            with_position = man is not None and man.position_m is not None
            forward_m = float(man.position_m[2]) if man and man.position_m is not None else np.nan
            cells.append(
                f"{forward_m:.2f} ({forward_m - by_hand_m:+.2f})" if with_position else "none"
            )
            images.append(shrink(image, 480))
        yield [stem, readings, *cells]
    columns = len(models(shared))
    rows = [np.hstack(images[k : k + columns]) for k in range(0, len(images), columns)]
    save(OUT / "tue.png", np.vstack(rows))


def save(path: Path, image: U8) -> None:
    """Write a picture (HxWx3, red first)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), image[:, :, ::-1])


CROSSING_HEADER = (
    *("model", "embedder", "tracker", "people a frame, mean (max)", "with 3D position"),
    *("found, by eye", "false, by eye", "tracks", "track length, mean / median"),
    "right identity, by eye",
)
CROSSING_NOTE = (
    "108 RGB-D frames of six people who walk a loop through a room and hide each other (640x480, "
    "10 frames a second, depth registered to colour). `By eye`: in six frames, 22 people were "
    "marked by hand; `false` are boxes without a person or on a person with another box; `right "
    "identity` are those whose track is theirs when people and tracks are paired one to one. "
    "Tracks are confirmed identities; six would be right, and one more for a head that passes "
    "below the camera at the start. Detector, embedder and the tracker `ships` have their "
    "defaults; [PIC4SeR] are the trackers with its constants."
)
BAGS_NOTE = (
    "Five frames of one man who stands in front of the camera, other people behind. By hand: depth "
    "in metres at three pixels on his torso. By model: forward distance of his 3D position in "
    "metres, in brackets less the median by hand; 0.25 m is what we allow."
)


def main() -> None:
    """Measure, write the tables, draw the sheets."""
    parser = argparse.ArgumentParser(description="Run the chain on recordings of real people.")
    parser.add_argument("--shared", type=Path, default=ROOT.parent / "shared")
    shared = parser.parse_args().shared
    cv2.setNumThreads(1)
    bags = markdown(["bag", "by hand", *models(shared)], list(bag_rows(shared)))
    crossing = markdown(CROSSING_HEADER, list(crossing_rows(shared)))
    parts = ("## Crossing people", CROSSING_NOTE, crossing, "## The man in front", BAGS_NOTE, bags)
    write(__file__, "Real people: what each model finds, places and tracks", *parts)


if __name__ == "__main__":
    main()
