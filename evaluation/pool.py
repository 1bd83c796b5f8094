"""Work in several processes of one thread each, with results in the order of the work."""

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

OnProgress = Callable[[str, float], object]  # name of a stage, share of its finished work

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class Pool:
    """Processes that start with the first work for more than one; use it in a `with` block.

    Args:
        jobs: Number of processes; 1: all work is done in this process.
        on_progress: Called when a stage begins, and after each piece of work.
    """

    def __init__(self, jobs: int, on_progress: OnProgress) -> None:
        self._jobs, self._on_progress = jobs, on_progress
        self._stack = ExitStack()
        self._executor: ProcessPoolExecutor | None = None

    def do(self, stage: str, work: Callable[[A], B], items: Sequence[A]) -> list[B]:
        """Run picklable work on all items, and return the results in order.

        Raises:
            People4dError: A process was killed. Errors of the work are raised, too.
        """
        self._on_progress(stage, 0.0)
        results: dict[int, B] = {}
        for index, result in self._results(work, items):
            results[index] = result
            self._on_progress(stage, len(results) / len(items))
        return [results[index] for index in range(len(items))]

    def _results(self, work: Callable[[A], B], items: Sequence[A]) -> Iterator[tuple[int, B]]:
        """Yield index and result of each item when it is finished."""
        if self._jobs == 1 or (len(items) < 2 and self._executor is None):
            yield from enumerate(map(work, items))
            return
        if self._executor is None:
            self._stack.enter_context(_one_thread_each())
            # A forked process would have the locks of threads, but not the threads.
            self._executor = ProcessPoolExecutor(self._jobs, get_context("spawn"), _begin)
        try:
            futures = {self._executor.submit(work, item): k for k, item in enumerate(items)}
            for future in as_completed(futures):
                yield futures[future], future.result()
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


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles interrupts
    cv2.setNumThreads(1)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Limit processes started in the block to one thread; libraries read the limit on loading."""
    before = {name: os.environ[name] for name in THREADS if name in os.environ}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name in THREADS:
            del os.environ[name]
        os.environ.update(before)
