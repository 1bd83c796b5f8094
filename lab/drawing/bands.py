"""Work in threads: several jobs, or an image in bands of rows.

The compiled functions release the interpreter lock, so what they do really happens at once.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from typing import TypeVar

T = TypeVar("T")


def at_once(jobs: Sequence[Callable[[], T]], threads: int) -> list[T]:
    """Return the results of jobs that do not depend on each other, in their order."""
    if threads <= 1:
        return [job() for job in jobs]
    with ThreadPoolExecutor(threads) as pool:
        started = [pool.submit(job) for job in jobs]
        return [job.result() for job in started]


def in_bands(work: Callable[[int, int], object], rows: int, threads: int) -> None:
    """Call `work(first, last)` for bands of rows that together are all rows.

    Each pixel depends on its own row only, so the result does not depend on the number of bands.

    Args:
        work: Writes the rows from first up to, but not with, last.
        rows: Of the image.
        threads: Number of bands.
    """
    bands = max(threads, 1)
    edges = [rows * band // bands for band in range(bands + 1)]
    at_once([partial(work, first, last) for first, last in pairwise(edges)], threads)
