"""Rendering of a scenario to a recording, a ROS 2 bag and a file with the truth of each frame."""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import msgspec

from common.io.recording import RecordingWriter, open_recording
from lab.depth.metadata import NAME
from lab.output.chunks import ChunkStore, digest_of, run_chunks
from lab.output.sequence import Fidelity, RenderJob, TimedMessage, sequence_renderer
from lab.truth.files import join_frames, save_frames
from people4d.errors import SourceError
from services.camera.ros.export import export

# Number of frames of a chunk: a few seconds of work, which an interruption loses
CHUNK_FRAMES: dict[Fidelity, int] = {"geometry": 300, "depth": 60, "colour": 10}


@dataclass(frozen=True, slots=True)
class Outputs:
    """Files to write; None: not written."""

    recording: Path | None = None  # people4d recording
    bag: Path | None = None  # folder of a ROS 2 bag
    truth: Path | None = None  # NPZ file with the truth of each person in each frame

    @property
    def paths(self) -> list[Path]:
        """All files and folders to write."""
        return [path for path in (self.recording, self.bag, self.truth) if path]

    @property
    def chunks(self) -> Path:
        """Folder of finished chunks, next to the first output."""
        return self.paths[0].with_name(f"{self.paths[0].name}.part")


def render(
    job: RenderJob, outputs: Outputs, jobs: int, on_progress: Callable[[str, float], object]
) -> None:
    """Render a scenario; an interrupted rendering is continued.

    SourceError if an output exists or cannot be written.

    Args:
        job: Scenario, fidelity and errors.
        outputs: Files to write.
        jobs: Number of processes; the result does not depend on it.
        on_progress: Called with the current step and its finished share, 0 to 1.
    """
    for path in outputs.paths:
        if path.exists():
            raise SourceError(f"{path} exists already", "Remove it, or give another --out.")
    store, size = ChunkStore(outputs.chunks, _key(job)), CHUNK_FRAMES[job.fidelity]
    count = -(-sequence_renderer(job).frame_count // size)
    missing = store.missing(count)
    on_progress("drawing", 1 - len(missing) / count)
    finished = run_chunks(partial(render_chunk, job, store, size), missing, jobs)
    for done, _ in enumerate(finished, 1):
        on_progress("drawing", 1 - (len(missing) - done) / count)
    chunks = [store.path(chunk) for chunk in range(count)]
    recording = store.path(count)
    with RecordingWriter(recording) as writer:
        writer.write_metadata(NAME, job.metadata.texts())
        for time_ns, message in sequence_renderer(job).timeline(_messages(chunks)):
            writer.write(message, time_ns)
    if outputs.bag:
        export(recording, outputs.bag, on_progress=partial(on_progress, "writing the bag"))
    if outputs.truth:
        join_frames(outputs.truth, [chunk.with_suffix(".npz") for chunk in chunks])
    if outputs.recording:
        recording.replace(outputs.recording)
    store.remove()


def render_chunk(job: RenderJob, store: ChunkStore, size: int, chunk: int) -> None:
    """Render the messages of a chunk of `size` frames into the store."""
    renderer, path = sequence_renderer(job), store.path(chunk)
    last = min((chunk + 1) * size, renderer.frame_count)
    unfinished = path.with_suffix(".new")
    truth = []
    with RecordingWriter(unfinished) as writer:
        for index in range(chunk * size, last):
            message, arrays = renderer.frame(index)
            writer.write(message, renderer.time_ns(index))
            if arrays:
                truth.append(arrays)
    if truth:
        save_frames(path.with_suffix(".npz"), renderer.world.info, truth)
    unfinished.replace(path)  # last: the chunk is now finished


def _messages(chunks: list[Path]) -> Iterator[TimedMessage]:
    for chunk in chunks:
        yield from open_recording(chunk).messages()


def _key(job: RenderJob) -> str:
    text = msgspec.json.encode(job) + digest_of(Path(__file__).parents[1]).encode()
    return hashlib.sha256(text).hexdigest()
