"""Work on an image in bands of rows, one thread each."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor


def in_bands(work: Callable[[int, int], object], rows: int, threads: int) -> None:
    """Call `work(first, last)` for bands of rows that together are all rows.

    The kernels called release the interpreter lock, so the bands run at the same time. Each
    pixel depends on its own row only, so the result does not depend on the number of bands.

    Args:
        work: Writes the rows from first up to, but not with, last.
        rows: Of the image.
        threads: Number of bands.
    """
    if threads <= 1:
        work(0, rows)
        return
    edges = [rows * band // threads for band in range(threads + 1)]
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, edges[:-1], edges[1:]))
