"""Whether light may travel in a medium."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.flat.flatten import FlatScene


def used_media(flat: FlatScene) -> NDArray[np.int32]:
    """Numbers of the media that some light may travel in, ascending."""
    bounded = flat.materials.medium[flat.triangles.materials].ravel()
    around = np.array([-1 if flat.camera.medium is None else flat.camera.medium], np.int32)
    used = np.unique(np.concatenate([bounded, flat.lights.medium, around]))
    return used[used >= 0]


def calls_for_media(flat: FlatScene) -> bool:
    """Whether some light may travel in a medium."""
    return len(used_media(flat)) > 0


def calls_for_grids(flat: FlatScene) -> bool:
    """Whether some light may travel in a medium whose density changes from place to place."""
    return bool(flat.media.heterogeneous[used_media(flat)].any())
