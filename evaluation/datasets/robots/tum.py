"""TUM RGB-D, freiburg3: people walk through the view of a moving camera whose pose is captured.

    SEQUENCE/rgb.txt, depth.txt, rgb/*.png, depth/*.png (5000 a metre), groundtruth.txt

Lines of the lists: time [s], file; of the truth: time, x, y, z, then the quaternion x, y, z, w. The
people have no truth. Evaluated is our visual odometry, which masks the people that the detector
finds, with the absolute and the relative error of the camera's trajectory.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from common.io.recording import open_recording
from evaluation.datasets.dataset import Dataset, DatasetJob, SequenceResult
from evaluation.datasets.robots.rgbd import calibrated, detected
from evaluation.datasets.robots.trajectories import NEAR_S, Poses, read_poses, score, trajectory
from evaluation.recordings.visual_motion import VisualMotion
from people4d.messages import MovingTransform
from services.camera.folder.layout import LISTS, listed
from services.visual_odometry.config import VisualOdometryConfig

TRUTH = "groundtruth.txt"
CALIBRATION = "fx = 535.4\nfy = 539.2\ncx = 320.1\ncy = 247.6\n"  # calibration of freiburg3 [px]


@dataclass(frozen=True, kw_only=True)
class TumDataset(Dataset):
    """Sequences of freiburg3."""

    def sequences(self, folder: Path) -> Sequence[str]:
        """Return the complete sequences."""
        found = sorted(folder.glob("rgbd_dataset_freiburg3_*"))
        if not found:
            self.require(folder / "rgbd_dataset_freiburg3_walking_xyz" / LISTS[0])
        for path in found:
            self.require(*(path / name for name in (*LISTS, TRUTH)))
        return [path.name for path in found]

    def evaluate(self, job: DatasetJob) -> SequenceResult:
        """Estimate the motion of the camera."""
        truth = read_poses(job.path / TRUTH)
        self._check(job.path, truth)
        camera = calibrated(job, job.path, CALIBRATION, {})
        files = detected(job, camera)
        people = [message for _, message in open_recording(files.detections).messages()]
        poses = {
            one.stamp_ns / 1e9: one.motion.matrix @ camera.mount_from_optical
            for one in VisualMotion(camera, VisualOdometryConfig(planar=False), people)
            if isinstance(one.motion, MovingTransform)
        }
        return SequenceResult(score(poses, truth), {f"{job.sequence}.txt": trajectory(poses)})

    def _check(self, path: Path, truth: Poses) -> None:
        """Check that all images are there, in the time of the truth."""
        pairs = listed(path, NEAR_S).pairs
        for pair in pairs:
            self.require(pair.colour, pair.depth)
        start_s, end_s = pairs[0].stamp_ns / 1e9, pairs[-1].stamp_ns / 1e9
        if end_s < min(truth) or start_s > max(truth):
            expected = f"poses from {start_s:.3f} to {end_s:.3f} s"
            raise self.mismatch(path / TRUTH, expected, f"{min(truth):.3f} to {max(truth):.3f} s")


TUM = TumDataset(
    title="TUM RGB-D, freiburg3",
    layout="https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats",
    licence="CC BY 4.0",
    obtain="Download the sequences fr3/walking_* from "
    "https://cvg.cit.tum.de/data/datasets/rgbd-dataset/download, unpack them into one folder, and "
    "name it.",
    metric="absolute and relative trajectory error as evaluate_ate.py and evaluate_rpe.py (1 s)",
    server="SEQUENCE.txt: time, x, y, z, quaternion x, y, z, w",
    preset="best",
    columns=("ate_rmse_m", "rpe_rmse_m", "rpe_rmse_rad"),
    tuning=("*_sitting_*",),  # the benchmark's usual split: people walk in the test sequences
)
