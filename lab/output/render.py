"""A scenario as a recording, a ROS 2 bag and a file of truth for each frame."""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import msgspec

from common.io.recording import RecordingWriter, open_recording
from lab.depth.metadata import NAME
from lab.output.chunks import ChunkStore, digest_of, run_chunks
from lab.output.sequence import Fidelity, RenderJob, sequence_renderer
from lab.truth.files import join_frames, save_frames
from people4d.errors import SourceError
from people4d.messages import Message
from services.camera.ros.export import export

# Frames in a piece: a few seconds of work, which is what an interruption costs.
PIECE_FRAMES: dict[Fidelity, int] = {"geometry": 300, "depth": 60, "colour": 10}


@dataclass(frozen=True, slots=True)
class Outputs:
    """What is written; None: not."""

    recording: Path | None = None  # file of ours
    bag: Path | None = None  # folder of a ROS 2 bag
    truth: Path | None = None  # NPZ file with the truth about each person in each frame

    @property
    def paths(self) -> list[Path]:
        """All that is written."""
        return [path for path in (self.recording, self.bag, self.truth) if path]

    @property
    def shelf(self) -> Path:
        """Folder of what is done so far, beside the first output."""
        return self.paths[0].with_name(f"{self.paths[0].name}.part")


def render(
    order: RenderJob, outputs: Outputs, jobs: int, progress: Callable[[str, float], object]
) -> None:
    """Render a scenario; what an interrupted rendering has done is not done again.

    Args:
        order: What is rendered.
        outputs: What is written.
        jobs: Processes that draw at once; the result does not depend on it.
        progress: Called with what is being done and the share of it that is done, 0 to 1.

    Raises:
        SourceError: An output exists or cannot be written.
    """
    for path in outputs.paths:
        if path.exists():
            raise SourceError(f"{path} exists already", "Remove it, or give another --out.")
    shelf, size = ChunkStore(outputs.shelf, _key(order)), PIECE_FRAMES[order.fidelity]
    count = -(-sequence_renderer(order).world.frame_count // size)
    missing = shelf.missing(count)
    progress("drawing", 1 - len(missing) / count)
    for done, _ in enumerate(run_chunks(partial(make_piece, order, shelf, size), missing, jobs), 1):
        progress("drawing", 1 - (len(missing) - done) / count)
    pieces = [shelf.path(piece) for piece in range(count)]
    recording = shelf.path(count)
    _write_recording(order, pieces, recording)
    if outputs.bag:
        export(recording, outputs.bag, on_progress=partial(progress, "writing the bag"))
    if outputs.truth:
        join_frames(outputs.truth, [_truth_of(piece) for piece in pieces])
    if outputs.recording:
        recording.replace(outputs.recording)
    shelf.remove()


def make_piece(order: RenderJob, shelf: ChunkStore, size: int, piece: int) -> None:
    """Make the messages of a piece of so many frames and put them on the shelf."""
    studio, path = sequence_renderer(order), shelf.path(piece)
    last = min((piece + 1) * size, studio.world.frame_count)
    unfinished = path.with_suffix(".new")
    truth = []
    with RecordingWriter(unfinished) as writer:
        for index in range(piece * size, last):
            message, arrays = studio.frame(index)
            writer.write(message, message.stamp_ns)
            if arrays:
                truth.append(arrays)
    if truth:
        save_frames(_truth_of(path), studio.world.info, truth)
    unfinished.replace(path)  # last: from now on the piece counts as done


def _write_recording(order: RenderJob, pieces: list[Path], path: Path) -> None:
    with RecordingWriter(path) as writer:
        writer.write_metadata(NAME, order.note.values())
        for message in sequence_renderer(order).timeline(_messages(pieces)):
            writer.write(message, message.stamp_ns)


def _messages(pieces: list[Path]) -> Iterator[Message]:
    for piece in pieces:
        for _, message in open_recording(piece).messages():
            yield message


def _truth_of(piece: Path) -> Path:
    return piece.with_suffix(".npz")


def _key(order: RenderJob) -> str:
    """Return what tells this rendering from any other, the lab's own code included."""
    text = msgspec.json.encode(order) + digest_of(Path(__file__).parents[1]).encode()
    return hashlib.sha256(text).hexdigest()
