"""Depth recordings of robots: detections, and the boxes of tracks in the image."""

from collections.abc import Mapping
from pathlib import Path

import msgspec
import numpy as np

from evaluation.cache import key_of
from evaluation.datasets.dataset import DatasetJob
from evaluation.recordings.detections import DetectionFiles, DetectionJob, detect
from people4d.messages import Detections, Tracks
from services.camera.config import CameraConfig
from services.tracker.image_sort.image_sort import BoxFrame, BoxTracks


def calibrated(
    job: DatasetJob, path: Path, calibration: str, options: Mapping[str, object]
) -> CameraConfig:
    """Return a moving camera whose calibration and mount are in no file of the data set."""
    file = job.cache / "datasets" / f"{key_of(calibration)}.toml"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(calibration, encoding="utf-8")
    options = {**options, "calibration": str(file)}
    return msgspec.structs.replace(
        job.method.camera, source=str(path), options=options, mount_parent="base_link"
    )


def detected(job: DatasetJob, camera: CameraConfig) -> DetectionFiles:
    """Return detections and embeddings of the people before a camera, cached."""
    method, reids = job.method, (job.method.reid,) if job.method.reid else ()
    return detect(DetectionJob(Path(camera.source), camera, method.detector, reids, job.cache))


def box_frame(found: Detections) -> BoxFrame:
    """Return detections as boxes."""
    boxes = np.array([one.box_xyxy_px for one in found.detections], np.float64).reshape(-1, 4)
    return BoxFrame(found.stamp_ns, boxes, np.array([one.score for one in found.detections]))


def box_tracks(found: Detections, tracks: Tracks | None) -> BoxTracks:
    """Return the boxes of detections under the identities of their tracks."""
    pairs = [
        (t.id, t.detection) for t in (tracks.tracks if tracks else ()) if t.detection is not None
    ]
    rows, boxes = [row for _, row in pairs], box_frame(found)
    ids = np.array([one for one, _ in pairs], np.int64)
    return BoxTracks(ids, boxes.boxes_xyxy_px[rows], boxes.scores[rows], np.array(rows, np.int64))
