"""Work in several processes of one thread each; results are in the order of the work."""

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from multiprocessing import get_context
from typing import Self, TypeVar

import cv2

from people4d.errors import People4dError

A = TypeVar("A")
B = TypeVar("B")

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class Pool:
    """Processes that are started when there is work for more than one; use it in a `with` block.

    Args:
        jobs: Processes at once; with one all is done in this process.
    """

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._stack = ExitStack()
        self._executor: ProcessPoolExecutor | None = None

    def do_all(
        self, work: Callable[[A], B], items: Sequence[A], done: Callable[[int], object]
    ) -> list[B]:
        """Do all pieces of work and return the results in their order.

        Args:
            work: Does one piece; it must be picklable.
            items: The pieces.
            done: Called with the index of each piece when it is done.

        Raises:
            People4dError: A process was killed. What a piece raises is raised here.
        """
        if self._jobs == 1 or (len(items) < 2 and self._executor is None):
            results = []
            for index, item in enumerate(items):
                results.append(work(item))
                done(index)
            return results
        executor = self._started()
        try:
            futures = {executor.submit(work, item): index for index, item in enumerate(items)}
            for future in as_completed(futures):
                future.result()
                done(futures[future])
            return [future.result() for future in futures]
        except BrokenProcessPool as error:
            raise People4dError(
                "a process of the evaluation was killed, perhaps because memory ran out",
                "Use fewer --jobs; the cache has the detections made so far.",
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._executor:
            self._executor.shutdown(wait=True, cancel_futures=True)
        self._stack.close()

    def _started(self) -> ProcessPoolExecutor:
        if self._executor is None:
            self._stack.enter_context(_one_thread_each())
            # A forked process would have the locks of threads, but not the threads.
            self._executor = ProcessPoolExecutor(self._jobs, get_context("spawn"), _begin)
        return self._executor


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
