"""KTP, Kinect Tracking Precision: five people before a robot that stands, drives and turns.

    images/SEQUENCE/rgb/TIME.jpg, depth/TIME.pgm (millimetres), ground_truth/SEQUENCE_gt2D.txt

A line of the truth is a time as in the names of the images, a colon, and id, left, top, width and
height of each person, with a comma after each. The images have no calibration file: the default
calibration of a Kinect applies. The robot's pose and the positions of motion capture are not read,
since no public source states their columns and frame. Visual odometry replaces the robot's pose.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from common.io.files import read_text
from common.metrics.record import BOOL
from evaluation.datasets.boxes import BoxSequence, BoxTruth
from evaluation.datasets.dataset import Dataset, DatasetJob, SequenceResult
from evaluation.datasets.mot import submission
from evaluation.datasets.robots.rgbd import box_frame, box_tracks, calibrated, detected
from evaluation.pipeline import track_again
from evaluation.recordings.detections import read_tracker_input
from evaluation.recordings.visual_motion import VisualMotionJob, estimate_motion
from people4d.errors import SourceError
from people4d.messages import Detections
from services.visual_odometry.config import VisualOdometryConfig

CALIBRATION = "fx = 525.0\nfy = 525.0\ncx = 319.5\ncy = 239.5\n"  # default of a Kinect [px]
IMAGES = {"colour": "rgb/*.jpg", "depth": "depth/*.pgm"}
MAX_BYTES = 2**26
PERSON = 5  # number of columns of a person


@dataclass(frozen=True, kw_only=True)
class KtpDataset(Dataset):
    """The sequences Still, Translation, Rotation and Arc."""

    def sequences(self, folder: Path) -> Sequence[str]:
        """Return the sequences, with images and truth."""
        self.require(folder / "images", folder / "ground_truth")
        found = sorted(path for path in (folder / "images").iterdir() if path.is_dir())
        if not found:
            self.require(folder / "images" / "Still")
        for path in found:
            self.require(path / "rgb", path / "depth", truth_file(folder, path.name))
        return [path.name for path in found]

    def evaluate(self, job: DatasetJob) -> SequenceResult:
        """Track people in 3D, and score the boxes of their detections."""
        path, file = job.folder / "images" / job.sequence, truth_file(job.folder, job.sequence)
        truth = read_truth(file)
        self._check(path, file, truth)
        camera = calibrated(job, path, CALIBRATION, IMAGES)
        found = detected(job, camera)
        motion = VisualMotionJob(camera, VisualOdometryConfig(), found.detections, job.cache)
        messages = list(
            read_tracker_input(estimate_motion(motion), next(iter(found.embeddings), None))
        )
        config = msgspec.structs.replace(
            job.method.tracker, embedding_wait_s=0.0, reorder_wait_s=0.0
        )
        tracks = {one.stamp_ns: one for one in track_again(messages, config)}
        annotated = [m for m in messages if isinstance(m, Detections) and m.stamp_ns in truth]
        frames = tuple(box_frame(one) for one in annotated)
        people = tuple(truth[one.stamp_ns] for one in annotated)
        boxes = [box_tracks(one, tracks.get(one.stamp_ns)) for one in annotated]
        scores = BoxSequence(job.sequence, frames, people).score(boxes)
        return SequenceResult(scores, {f"{job.sequence}.txt": submission(boxes)})

    def _check(self, path: Path, file: Path, truth: Mapping[int, BoxTruth]) -> None:
        """Check that each annotated image is there, with its depth."""
        stems = {stamp_of(one.stem): one.stem for one in sorted((path / "rgb").glob("*.jpg"))}
        absent = sorted(truth.keys() - stems.keys())
        if absent:
            got = f"{len(absent)} of {len(truth)} times without one, the first {absent[0]} ns"
            raise self.mismatch(file, f"times of images in {path / 'rgb'}", got)
        self.require(*(path / "depth" / f"{stems[stamp]}.pgm" for stamp in truth))


KTP = KtpDataset(
    title="KTP",
    layout="https://github.com/InesSousa11/samurai-real-time/tree/main/evaluation",
    licence="none stated",
    obtain="Download KTP_dataset_images.zip, named on "
    "http://www.dei.unipd.it/~munaro/KTP-dataset.html, unpack it, and name the folder with images "
    "and ground_truth.",
    metric="MOTA, IDF1 and HOTA of boxes as TrackEval's MotChallenge2DBox, in annotated images",
    server="SEQUENCE.txt in the form of the MOT-Challenge, frames in the order of annotated images",
    preset="best",
    columns=("hota", "mota", "idf1", "id_switches"),
    tuning=(),
)


def truth_file(folder: Path, sequence: str) -> Path:
    """Return the file with the boxes of a sequence."""
    return folder / "ground_truth" / f"{sequence}_gt2D.txt"


def stamp_of(text: str) -> int:
    """Return a time in seconds as nanoseconds; ValueError if the text is no time."""
    seconds, _, fraction = text.strip().partition(".")
    return int(seconds) * 10**9 + int(f"{fraction[:9]:0<9}")


def read_truth(path: Path) -> dict[int, BoxTruth]:
    """Read the boxes of a sequence by stamp [ns]; SourceError if a line has other columns."""
    try:
        return dict(_lines(read_text(path, MAX_BYTES)))
    except (OSError, ValueError) as error:
        raise SourceError(f"{path}: {error}", KTP.obtain) from error


def _lines(text: str) -> Iterator[tuple[int, BoxTruth]]:
    for number, line in enumerate(text.splitlines(), 1):
        time, colon, people = line.partition(":")
        words = people.replace(",", " ").split()
        if not line.strip():
            continue
        if not colon or len(words) % PERSON:
            expected = "a time, a colon, and id, left, top, width, height of each person"
            raise ValueError(f"line {number}: expected {expected}, got {line!r:.60}")
        table = np.array(words, np.float64).reshape(-1, PERSON)
        boxes = np.hstack([table[:, 1:3], table[:, 1:3] + table[:, 3:5]])
        everyone: BOOL = np.ones(len(table), np.bool_)
        yield (
            stamp_of(time),
            BoxTruth(tuple(table[:, 0].astype(int).tolist()), boxes, everyone, ~everyone),
        )
