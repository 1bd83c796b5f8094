"""Time of the tracker's node in a frame: decoding, tracking and encoding, by number of people.

The inputs are messages of a detector and an embedder about people who walk back and forth. The
references in the same run are the method of [PIC4SeR] on the same bytes, and decoding and encoding
alone.
"""

import gc
import time
from collections import defaultdict
from collections.abc import Callable, Sequence

import numpy as np
from msgspec.structs import replace

from benchmarks.lib.system.bare import FLOAT, bare_ms
from benchmarks.lib.table import markdown, spread
from common.geometry.transforms import LINK_FROM_OPTICAL, invert, transform_from
from evaluation.methods import read_method
from people4d import codec
from people4d.messages import F64, CameraInfo, Detection, Detections, Embeddings, StaticTransform
from services.tracker.build import build
from services.tracker.interface import Measurement, Observation
from services.tracker.node import TrackerNode
from services.tracker.observe import PEOPLE_MAX

PEOPLE = (3, 10, 50, PEOPLE_MAX)
LIMITS_MS = {50: 2.0, PEOPLE_MAX: 5.0}  # Wanted p50 by number of people
FRAMES, QUICK_FRAMES = 150, 10
WARM_UP = 15  # frames
DIMENSION = 512  # length of an embedding, as in OSNet
FRAME_NS = 33_333_333
SIZE_PX = (640, 480)
PRESETS = ("best", "pose-strongsort-movenet")
CAMERA = "camera_optical_frame"
MAP_FROM_OPTICAL = transform_from((0.0, 0.0, 1.0), LINK_FROM_OPTICAL[:3, :3])

HEADER = ("tracker", "people", "p50 ms", "p99 ms", "p50, part of a float run", "wanted")
NOTE = f"""In {{rounds}} rounds of {{frames}} frames: from the bytes of embeddings and detections to
the bytes of tracks, in time of the process. A float run is one of the detector's float network
alone. {PEOPLE_MAX} people are the maximum of a frame; the rest is dropped and counted."""


def observations(people: int, frames: int, seed: int) -> list[Observation]:
    """Return frames of people walking back and forth across the image, with noise."""
    rng = np.random.default_rng(seed)
    appearances = rng.normal(size=(people, DIMENSION))
    phase, forward_m = rng.uniform(0, 2 * np.pi, people), np.linspace(2.0, 5.0, people)
    tracks = []
    for number in range(frames):
        stamp_ns = number * FRAME_NS
        side_m = 1.5 * np.sin(phase + 0.7 * stamp_ns / 1e9)
        measurements = []
        for k in range(people):
            position = np.array([forward_m[k], side_m[k], 1.0]) + rng.normal(0, 0.03, 3)
            u, half = 320 - 600 * side_m[k] / forward_m[k], 150 / forward_m[k]
            appearance = appearances[k] + rng.normal(0, 0.1, DIMENSION)
            measurements.append(
                Measurement(
                    index=k,
                    box_xyxy_px=np.array([u - half, 240 - 3 * half, u + half, 240 + 3 * half]),
                    score=0.9,
                    position_m=position,
                    forward_m=float(position[0]),
                    covariance_m2=np.diag([0.01, 0.001, 0.001]),
                    embedding=appearance / np.linalg.norm(appearance),
                    yaw_rad=float(rng.normal(0, 0.3)),
                    yaw_sigma_rad=0.3,
                )
            )
        camera = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1], [0, 0, 0, 1]])
        tracks.append(
            Observation(
                stamp_ns,
                tuple(measurements),
                embedder="osnet",
                map_from_camera=camera,
                size_px=SIZE_PX,
            )
        )
    return tracks


def payloads(observation: Observation, sequence: int) -> list[bytes]:
    """Return the encoded embeddings and detections of a frame."""
    people = observation.measurements
    stamp_ns = observation.stamp_ns
    detections = Detections(
        stamp_ns=stamp_ns,
        sequence=sequence,
        camera="camera",
        frame_id=CAMERA,
        model="benchmark",
        width=SIZE_PX[0],
        height=SIZE_PX[1],
        detections=tuple(map(_detection, people)),
    )
    embeddings = Embeddings(
        stamp_ns=stamp_ns,
        sequence=sequence,
        camera="camera",
        model=observation.embedder,
        detections=tuple(m.index for m in people),
        vectors=np.array([m.embedding for m in people], np.float32),
    )
    return [codec.encode(embeddings), codec.encode(detections)]


def _detection(measurement: Measurement) -> Detection:
    turn = MAP_FROM_OPTICAL[:3, :3]
    point: F64 = (invert(MAP_FROM_OPTICAL) @ [*measurement.position_m, 1.0])[:3]
    return Detection(
        box_xyxy_px=measurement.box_xyxy_px.astype(np.float32),
        score=measurement.score,
        position_m=point,
        position_covariance_m2=turn.T @ np.diag([0.01, 0.001, 0.001]) @ turn,
        heading=turn.T @ [-1.0, 0.0, 0.0],
        heading_sigma_rad=0.3,
    )


def node_of(preset: str) -> TrackerNode:
    """Return the node of a preset with a calibrated camera."""
    config = replace(read_method(preset).tracker, embedding_wait_s=0.0, reorder_wait_s=0.0)
    node = build(config)
    link = StaticTransform(
        stamp_ns=0, sequence=0, parent="map", child=CAMERA, matrix=MAP_FROM_OPTICAL
    )
    info = CameraInfo(
        stamp_ns=0,
        sequence=0,
        camera="camera",
        frame_id=CAMERA,
        width=SIZE_PX[0],
        height=SIZE_PX[1],
        fx=600.0,
        fy=600.0,
        cx=320.0,
        cy=240.0,
    )
    for message in (link, info):
        node.handle(message, 0)
    return node


def times_ms(frames: Sequence[list[bytes]], handle: Callable[[bytes], object]) -> F64:
    """Return the time of each frame in this process, independent of other programs."""
    times = []
    for frame in frames:
        start_ns = time.process_time_ns()
        for payload in frame:
            handle(payload)
        times.append((time.process_time_ns() - start_ns) / 1e6)
    return np.array(times[WARM_UP:])


def tracked(node: TrackerNode) -> Callable[[bytes], object]:
    """Return the handling of one encoded message."""
    return lambda payload: [codec.encode(m) for m in node.handle(codec.decode(payload), 0)]


def copied(payload: bytes) -> bytes:
    """Return a message decoded and encoded again."""
    return codec.encode(codec.decode(payload))


def tracker_table(rounds: int, quick: bool) -> str:
    """Return the table of all methods, measured in turns."""
    frames = QUICK_FRAMES if quick else FRAMES
    found: dict[tuple[str, int], list[F64]] = defaultdict(list)
    bare = list[float]()
    for seed in range(rounds):
        bare.append(bare_ms(FLOAT))
        for people in PEOPLE:
            print(f"round {seed + 1} of {rounds}, {people} people", flush=True)
            walking = observations(people, frames + WARM_UP, seed)
            encoded = [payloads(frame, number) for number, frame in enumerate(walking)]
            gc.collect()
            gc.freeze()  # same state as in every process after loading
            for preset in PRESETS:
                found[preset, people].append(times_ms(encoded, tracked(node_of(preset))))
            found["input decoded and encoded", people].append(times_ms(encoded, copied))
    rows = []
    for (name, people), times in found.items():
        p50, p99 = ([float(np.percentile(ms, q)) for ms in times] for q in (50, 99))
        share = [ms / run_ms for ms, run_ms in zip(p50, bare, strict=True)]
        limit = LIMITS_MS.get(people) if name == PRESETS[0] else None
        wanted = f"at most {limit:g} ms" if limit else ""
        rows.append([name, str(people), spread(p50), spread(p99), spread(share), wanted])
    table = markdown(HEADER, rows)
    return f"{NOTE.format(rounds=rounds, frames=frames)}\n\n{table}"
