"""A scene's triangles on disk, so that a master may send them again and again, and hold none of them in memory."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from wdpm.scenes.flat.arrays import ARRAYS, Triangles
from wdpm.scenes.flat.room import in_file, let_go, lies_in_file


def spooled(triangles: Triangles) -> Triangles:
    """The same triangles, in files without names, which end with them (scenes.flat.room).

    Those that lie there stay; where the disk has no room they are in memory.
    """
    return triangles.with_arrays({name: _spooled(getattr(triangles, name)) for name in ARRAYS})


def _spooled(array: NDArray[Any]) -> NDArray[Any]:
    if lies_in_file(array):
        return array
    copy = in_file(array.shape, array.dtype)
    if not lies_in_file(copy):
        return array
    copy[...] = array
    let_go(copy)
    return copy
