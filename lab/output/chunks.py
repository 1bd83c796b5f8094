"""Long work in pieces: done by all cores, and kept when it is interrupted."""

import hashlib
import shutil
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path

from people4d.errors import People4dError, SourceError

KEY = "key"  # file that says what the pieces are of


class ChunkStore:
    """A folder of finished pieces; they stay until they are of other work.

    Args:
        folder: Made if it is not there.
        key: Tells this work from any other. Pieces with another key are removed.

    Raises:
        SourceError: The folder cannot be written, or holds something else.
    """

    def __init__(self, folder: Path, key: str) -> None:
        self._folder = folder
        try:
            if folder.exists() and any(folder.iterdir()) and not (folder / KEY).is_file():
                raise SourceError(f"folder {folder} is in the way", "Move it elsewhere.")
            if folder.exists() and _read(folder / KEY) != key:
                shutil.rmtree(folder)
            folder.mkdir(parents=True, exist_ok=True)
            (folder / KEY).write_text(key)
        except OSError as error:
            raise SourceError(f"folder {folder} cannot be written: {error.strerror}") from error

    def path(self, piece: int) -> Path:
        """Return where a piece is, or will be."""
        return self._folder / f"{piece:06d}"

    def missing(self, count: int) -> list[int]:
        """Return those of so many pieces that are not there."""
        return [piece for piece in range(count) if not self.path(piece).exists()]

    def remove(self) -> None:
        """Remove all."""
        shutil.rmtree(self._folder, ignore_errors=True)


def run_chunks(work: Callable[[int], None], pieces: Sequence[int], jobs: int) -> Iterator[int]:
    """Do pieces of work, and yield each once it is done.

    Args:
        work: Does one piece; with more than one job it must be picklable.
        pieces: What is to be done.
        jobs: Processes that work at once; with one it is done in this process.

    Raises:
        People4dError: A process was killed. What a piece raises is raised here.
    """
    if jobs == 1 or len(pieces) < 2:
        for piece in pieces:
            work(piece)
            yield piece
        return
    # Forked, a process would have locks of threads that it has not.
    context = get_context("spawn")
    pool = ProcessPoolExecutor(min(jobs, len(pieces)), context, _leave_interrupts_to_the_parent)
    try:
        futures = {pool.submit(work, piece): piece for piece in pieces}
        for future in as_completed(futures):
            future.result()
            yield futures[future]
    except BrokenProcessPool as error:
        raise People4dError(
            "a process that renders was killed, perhaps for want of memory",
            "Render with fewer --jobs; what is done is kept.",
        ) from error
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def digest_of(folder: Path) -> str:
    """Return what tells the contents of a folder of code and data from any other version."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.suffix in (".py", ".npz", ".toml"):
            digest.update(f"{path.relative_to(folder)} {path.stat().st_size}\n".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _read(path: Path) -> str:
    try:
        return path.read_text()
    except (OSError, ValueError):
        return ""
