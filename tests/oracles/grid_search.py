"""Cheapest paths through the cells of a grid in space, by Python."""

import heapq
from itertools import product

import numpy as np
import numpy.typing as npt


def settle_by_python(
    price: npt.NDArray[np.float32],
    room: npt.NDArray[np.float32],
    start: int,
    goal: int,
    before: npt.NDArray[np.int64],
    cost: npt.NDArray[np.float32],
) -> None:
    """Fill in the preceding cell and the cost of every cell, as ``cheapest_way`` of ``grid_ways.c``, in place."""
    shape = price.shape
    flat = price.ravel()
    gaps = room.ravel()
    least = 0.0 if goal < 0 else float(np.min(flat[flat > 0.0]))
    target = np.array(np.unravel_index(max(goal, 0), shape))
    steps = [np.array(step) for step in product((-1, 0, 1), repeat=3) if any(step)]
    settled: set[int] = set()
    heap = [(0.0, start)]
    before[start] = start
    cost[start] = 0.0
    while heap:
        _, cell = heapq.heappop(heap)
        if cell in settled:
            continue
        settled.add(cell)
        if cell == goal:
            return
        place = np.array(np.unravel_index(cell, shape))
        for step in steps:
            other = place + step
            if np.any(other < 0) or np.any(other >= shape):
                continue
            number = int(np.ravel_multi_index(tuple(other), shape))
            if flat[number] <= 0.0 or number in settled:
                continue
            length = float(np.linalg.norm(step))
            # If the free balls around two cell centres do not intersect, a thin wall may lie between them.
            if float(gaps[cell] + gaps[number]) < length:
                continue
            trial = float(cost[cell]) + 0.5 * length * float(flat[cell] + flat[number])
            if trial < cost[number]:
                cost[number] = trial
                before[number] = cell
                heapq.heappush(heap, (trial + least * float(np.linalg.norm(other - target)), number))
