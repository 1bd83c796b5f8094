"""Parallel work in chunks; finished chunks survive an interruption."""

import hashlib
import shutil
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path

from people4d.errors import People4dError, SourceError

KEY = "key"  # file that identifies the work


class ChunkStore:
    """Folder of finished chunks; chunks of other work are removed.

    SourceError if the folder cannot be written, or holds other files.

    Args:
        folder: The folder; created if absent.
        key: Identifier of the work.
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

    def path(self, chunk: int) -> Path:
        """Return the file of a chunk, finished or not."""
        return self._folder / f"{chunk:06d}"

    def missing(self, count: int) -> list[int]:
        """Return the numbers of unfinished chunks below a count."""
        return [chunk for chunk in range(count) if not self.path(chunk).exists()]

    def remove(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self._folder, ignore_errors=True)


def run_chunks(work: Callable[[int], None], chunks: Sequence[int], jobs: int) -> Iterator[int]:
    """Run chunks of work, and yield the number of each finished chunk.

    People4dError if a process was killed, or a chunk failed.

    Args:
        work: Runs one chunk; picklable for more than one job.
        chunks: Numbers of the chunks.
        jobs: Number of processes; 1: this process.
    """
    if jobs == 1 or len(chunks) < 2:
        for chunk in chunks:
            work(chunk)
            yield chunk
        return
    # A forked process would inherit locks of threads that it does not have.
    context = get_context("spawn")
    pool = ProcessPoolExecutor(min(jobs, len(chunks)), context, _leave_interrupts_to_the_parent)
    try:
        futures = {pool.submit(work, chunk): chunk for chunk in chunks}
        for future in as_completed(futures):
            future.result()
            yield futures[future]
    except BrokenProcessPool as error:
        raise People4dError(
            "a process that renders was killed, perhaps for want of memory",
            "Render with fewer --jobs; finished frames stay.",
        ) from error
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def digest_of(folder: Path) -> str:
    """Return a fingerprint of the code and data in a folder."""
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
