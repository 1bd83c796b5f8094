"""Parallel work on several items, one process for each processor."""

import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any, TypeVar

T = TypeVar("T")
R = TypeVar("R")

# Stack of nested calls; the innermost call is last
_work: list[tuple[Callable[[Any], Any], Sequence[Any]]] = []


def each(work: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """Return the results of a function for all items, in their order.

    The function and the items need not be picklable, since processes are forked.
    """
    _work.append((work, items))
    context = multiprocessing.get_context("fork")
    try:
        with ProcessPoolExecutor(len(os.sched_getaffinity(0)), mp_context=context) as pool:
            return list(pool.map(_one, range(len(items))))
    finally:
        _work.pop()


def _one(number: int) -> Any:
    work, items = _work[-1]
    return work(items[number])
