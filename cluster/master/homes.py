"""Where tasks of an image are best at home: with the slave that holds the cell which their pixels see.

Camera rays, what they see and what is gathered there then need not travel. Any slave may be a task's home, and no bit
depends on which: so this is a wish, and who has nothing else to do is handed any task (master.waiting).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.session import Session
from wdpm.cluster.task import BucketTask

ANYWHERE = -1
"""In place of a cell: a task that no cell has a claim to."""


def cells_of_pixels(session: Session, pixels: NDArray[np.int32]) -> NDArray[np.int32]:
    """The cell that each of some pixels sees, about; ANYWHERE where it is not known, shape [pixels].

    Args:
        pixels: counted row by row.
    """
    camera, (rows, columns) = session.view.camera, session.sight.shape
    if not session.sight.size:
        return np.full(len(pixels), ANYWHERE, np.int32)
    y, x = np.divmod(pixels.astype(np.int64), camera.width)
    seen: NDArray[np.int32] = session.sight[y * rows // camera.height, x * columns // camera.width]
    return seen


def cell_of_bucket(session: Session, task: BucketTask) -> int:
    """The cell that most of a bucket's pixels see, about; ANYWHERE where it is not known."""
    camera, (rows, columns) = session.view.camera, session.sight.shape
    if not session.sight.size:
        return ANYWHERE
    top, left = task.y0 * rows // camera.height, task.x0 * columns // camera.width
    bottom, right = -(-task.y1 * rows // camera.height), -(-task.x1 * columns // camera.width)
    seen = session.sight[top:bottom, left:right]
    seen = seen[seen >= 0]
    return int(np.bincount(seen).argmax()) if len(seen) else ANYWHERE


def home_cells(seen: NDArray[np.int32], homes: int) -> NDArray[np.int32]:
    """The cell whose holder is each candidate's home: the one that it sees, if that is among those most are about.

    What sees another cell, or nothing, goes cell by cell to whichever home has the fewest.

    Args:
        seen: cells that candidates see, ANYWHERE where none is known, shape [candidates].
        homes: most cells that the result names, >= 1.

    Returns:
        cells, shape [candidates]; all ANYWHERE if no candidate sees a cell.
    """
    cells, sizes = np.unique(seen, return_counts=True)
    known = cells != ANYWHERE
    if not known.any():
        return seen
    by_size = np.argsort(np.where(known, -sizes, 1), kind="stable")
    chosen, others = by_size[: min(homes, int(known.sum()))], by_size[min(homes, int(known.sum())) :]
    home, load = cells.copy(), sizes[chosen]
    for other in others:
        least = int(load.argmin())
        home[other] = cells[chosen[least]]
        load[least] += sizes[other]
    out: NDArray[np.int32] = home[np.searchsorted(cells, seen)]
    return out
