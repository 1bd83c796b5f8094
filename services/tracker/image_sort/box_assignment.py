"""Assignment of boxes to tracks: intersection over union, Hungarian method; compiled."""

import numpy as np
import numpy.typing as npt

from common.compiled import compiled
from people4d.messages import F64

I64 = npt.NDArray[np.int64]


@compiled
def iou(a: F64, b: F64) -> float:
    """Return the intersection over union of two boxes (4, xyxy); 0 if they only touch."""
    width = min(a[2], b[2]) - max(a[0], b[0])
    if width <= 0:
        return 0.0
    height = min(a[3], b[3]) - max(a[1], b[1])
    if height <= 0:
        return 0.0
    overlap = width * height
    both = (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1])
    return float(overlap / (both - overlap))


@compiled
def assign(gain: F64) -> I64:
    """Return the column (N) of each row at the largest sum of gains (NxM), -1 where there is none.

    Pairs of gain 0 may not be matched.
    """
    n, m = gain.shape
    column_of = np.full(n, -1, np.int64)
    choices, last = np.zeros(n, np.int64), np.zeros(n, np.int64)
    rivals = np.zeros(m, np.int64)
    for i in range(n):
        for j in range(m):
            if gain[i, j] > 0:
                choices[i] += 1
                last[i] = j
                rivals[j] += 1
    # A pair without rivals needs no search, and most pairs have none.
    open_rows, open_columns = np.empty(n, np.int64), np.empty(m, np.int64)
    rows = columns = 0
    for i in range(n):
        if choices[i] == 1 and rivals[last[i]] == 1:
            column_of[i] = last[i]
            rivals[last[i]] = 0
        elif choices[i] > 0:
            open_rows[rows] = i
            rows += 1
    for j in range(m):
        if rivals[j] > 0:
            open_columns[columns] = j
            columns += 1
    if rows == 0:
        return column_of
    cost = np.zeros((rows, columns + rows))  # a column of its own for each row: no match
    for i in range(rows):
        for j in range(columns):
            cost[i, j] = -gain[open_rows[i], open_columns[j]]
    found = shortest_paths(cost)
    for i in range(rows):
        if found[i] < columns and cost[i, found[i]] < 0:
            column_of[open_rows[i]] = open_columns[found[i]]
    return column_of


@compiled
def shortest_paths(cost: F64) -> I64:
    """Return the column of each row at the least sum of costs.

    Rows are added one by one along the shortest augmenting path [Jonker 1987]; N <= M.
    """
    n, m = cost.shape
    row_price, column_price = np.zeros(n), np.zeros(m)
    column_of, row_of = np.full(n, -1, np.int64), np.full(m, -1, np.int64)
    distance, before = np.empty(m), np.empty(m, np.int64)
    done = np.empty(m, np.bool_)
    for start in range(n):
        distance[:] = np.inf
        done[:] = False
        row, least, end = start, 0.0, -1
        while end < 0:
            nearest = -1
            for j in range(m):
                if done[j]:
                    continue
                reach = least + cost[row, j] - row_price[row] - column_price[j]
                if reach < distance[j]:
                    distance[j], before[j] = reach, row
                if nearest < 0 or distance[j] < distance[nearest]:
                    nearest = j
            least = distance[nearest]
            done[nearest] = True
            if row_of[nearest] < 0:
                end = nearest
            else:
                row = row_of[nearest]
        row_price[start] += least
        for j in range(m):
            if done[j] and j != end:
                row_price[row_of[j]] += least - distance[j]
                column_price[j] -= least - distance[j]
        while end >= 0:
            row = before[end]
            row_of[end] = row
            column_of[row], end = end, column_of[row]
    return column_of
