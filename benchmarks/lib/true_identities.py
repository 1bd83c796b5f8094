"""Embeddings that distinguish all people: the upper bound of appearance for a tracker."""

from dataclasses import replace

import msgspec
import numpy as np

from common.geometry.transforms import apply
from common.io.recording import RecordingWriter, open_recording
from evaluation.run.run import EvaluationRun
from people4d.messages import F32, Detections, Embeddings

NEAR_M = 0.6  # [m] maximum distance on the ground of a detection from its person


def with_true_identities(run: EvaluationRun) -> EvaluationRun:
    """Return a run with the identities of the nearest true people as embeddings, in a new file."""
    assert run.embeddings
    path = run.embeddings.with_name(f"{run.embeddings.stem}-true.mcap")
    found = (message for _, message in open_recording(run.detections).messages(Detections))
    detections = [message for message in found if isinstance(message, Detections)]
    frames = {message.stamp_ns: number for number, message in enumerate(detections)}
    with RecordingWriter(path) as writer:
        for _, message in open_recording(run.embeddings).messages(Embeddings):
            if not isinstance(message, Embeddings):
                continue
            number = frames[message.stamp_ns]
            vectors = [
                _vector(run, number, detections[number], index) for index in message.detections
            ]
            shape = (len(vectors), len(run.truth.ids) + 1)
            rows = np.array(vectors, np.float32).reshape(shape)
            relabelled = msgspec.structs.replace(message, vectors=rows)
            writer.write(relabelled, message.stamp_ns)
    return replace(run, embeddings=path)


def _vector(run: EvaluationRun, number: int, detections: Detections, index: int) -> F32:
    """Return the unit vector of a detection's person; false alarms share the last vector."""
    ids, frame = run.truth.ids, run.truth.frames[number]
    vector = np.zeros(len(ids) + 1, np.float32)
    position_m, who = detections.detections[index].position_m, len(ids)
    if frame is not None and frame.map_from_camera is not None and position_m is not None:
        at_m = apply(frame.map_from_camera, position_m)
        distances_m = [float(np.hypot(*(one.position_m - at_m)[:2])) for one in frame.people]
        if distances_m and min(distances_m) < NEAR_M:
            who = ids.index(frame.people[int(np.argmin(distances_m))].id)
    vector[who] = 1.0
    return vector
