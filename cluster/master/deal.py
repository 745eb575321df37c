"""Who holds what: cells shared out so that no load is heavy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def deal(burdens: NDArray[np.float64], workers: int) -> list[int]:
    """Hand cells to workers so that the heaviest load is light: heaviest cell first, to whoever has least.

    Args:
        burdens: what each cell weighs, shape [cells]; at least as many cells as workers.

    Returns:
        The worker that holds each cell. Every worker gets a cell.
    """
    load = np.zeros(workers)
    holders = [0] * len(burdens)
    for cell in np.argsort(-burdens, kind="stable"):
        empty = np.flatnonzero(load == 0)
        worker = int(empty[0]) if len(empty) else int(np.argmin(load))
        holders[cell] = worker
        load[worker] += max(float(burdens[cell]), np.finfo(np.float64).tiny)
    return holders
