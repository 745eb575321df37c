"""Who holds which cell: cells assigned to workers so that the heaviest load is light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def balanced_holders(burdens: NDArray[np.float64], workers: int) -> list[int]:
    """Assign cells to workers, heaviest cell first, each to whoever has least (longest processing time, Graham 1969).

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
