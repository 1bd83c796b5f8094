"""Work in several processes of one thread each; results come in the order of the work."""

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
from typing import TypeVar

import cv2

from common.errors import People4dError

A = TypeVar("A")
B = TypeVar("B")

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def do_all(
    work: Callable[[A], B], items: Sequence[A], jobs: int, done: Callable[[int], object]
) -> list[B]:
    """Do all pieces of work.

    Args:
        work: Does one piece; with more than one job it must be picklable.
        items: The pieces.
        jobs: Processes at once; with one all is done in this process.
        done: Called with the index of each piece when it is done.

    Raises:
        People4dError: A process was killed. What a piece raises is raised here.
    """
    if jobs == 1 or len(items) < 2:
        results = []
        for index, item in enumerate(items):
            results.append(work(item))
            done(index)
        return results
    with _one_thread_each():
        # Forked, a process would have locks of threads that it has not.
        pool = ProcessPoolExecutor(min(jobs, len(items)), get_context("spawn"), _begin)
        try:
            futures = {pool.submit(work, item): index for index, item in enumerate(items)}
            for future in as_completed(futures):
                future.result()
                done(futures[future])
            return [future.result() for future in futures]
        except BrokenProcessPool as error:
            raise People4dError(
                "a process that evaluates was killed, perhaps for want of memory",
                "Use fewer --jobs; detections that are made are kept.",
            ) from error
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends what is interrupted
    cv2.setNumThreads(1)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Let processes that are started meanwhile use one thread: libraries read that on loading."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
